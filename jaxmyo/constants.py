"""Named sets of material constants of the Lin–Yin law, each with its source and units.

Three sets are in play, because the numbers that the paper (Bourdarias, Gerbi, Ohayon, "A pseudo active kinematic
constraint for a biological living soft tissue") prints, those that reproduce its Table 1, and those that reproduce the
measurement it rests on (Lin & Yin 1998, J Biomech Eng 120:504–517) are not the same:

| set        | C1p kPa | C2p, C3p, C4p        | C2a kPa | reproduces                                                |
| ---------- | ------- | -------------------- | ------- | --------------------------------------------------------- |
| `PRINTED`  | 0.292   | 0.321, −0.260, 0.201 | 4.830   | neither: Table 1 comes out 2–5 points and 1 kPa off       |
| `TABLE1`   | 0.0292  | 3.21, −2.60, 2.01    | 4.083   | the 40 entries of Table 1, to the printed digit           |
| `MEASURED` | 0.292   | 3.21, −2.60, 2.01    | 4.083   | the equibiaxial curves of Lin & Yin 1998, Fig. 4          |

The likely story: 0.0292 N/cm² = 0.292 kPa goes with the exponents 3.21, −2.60, 2.01. Table 1 was computed with the
number but without its unit, the text moved a power of ten into the exponents, and 4.083 lost its order in print.
"""

from dataclasses import dataclass

import jax
from jax import Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LinYin:
    """Constants of the Lin–Yin law `jaxmyo.energies.lin_yin`.

    C1p [kPa], C2p, C3p, C4p [–]: passive part; C1a, C2a, C3a, C4a [kPa]: active part.
    A pytree: every constant may be an array under `vmap`, or the variable of a derivative.
    """

    C1p: float | Array
    C2p: float | Array
    C3p: float | Array
    C4p: float | Array
    C1a: float | Array
    C2a: float | Array
    C3a: float | Array
    C4a: float | Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Guccione:
    """Constants of the transversely isotropic Guccione law `jaxmyo.energies.guccione`.

    C [kPa]; bf, bt, bfs [–]: along the fibre, across it, and in shear between the two. A pytree, as `LinYin`.
    """

    C: float | Array
    bf: float | Array
    bt: float | Array
    bfs: float | Array


#: Passive ventricle, problem 2 of the verification benchmark of Land et al. 2015, Proc R Soc A 471:20150641: isotropic.
LAND_PASSIVE = Guccione(C=10.0, bf=1.0, bt=1.0, bfs=1.0)

#: Active ventricle, problem 3 of the same: anisotropic; fibres +90° to −90° there, and T0 = 60 kPa.
LAND_ACTIVE = Guccione(C=2.0, bf=8.0, bt=2.0, bfs=4.0)

#: As printed in the text of the paper, section "Case of a thin sample of living myocardium".
PRINTED = LinYin(C1p=0.292, C2p=0.321, C3p=-0.260, C4p=0.201, C1a=-3.870, C2a=4.830, C3a=2.512, C4a=0.951)

#: What Table 1 of the paper was computed with: all 40 entries come out within 0.0054 of the printed ones.
TABLE1 = LinYin(C1p=0.0292, C2p=3.21, C3p=-2.60, C4p=2.01, C1a=-3.870, C2a=4.083, C3a=2.512, C4a=0.951)

#: What reproduces the measurement, Lin & Yin 1998, Fig. 4, with T0 = 0.6 kPa and nothing fitted.
MEASURED = LinYin(C1p=0.292, C2p=3.21, C3p=-2.60, C4p=2.01, C1a=-3.870, C2a=4.083, C3a=2.512, C4a=0.951)

#: The three sets by the names that the command line and the CSV files use.
SETS = {"printed": PRINTED, "table1": TABLE1, "measured": MEASURED}
