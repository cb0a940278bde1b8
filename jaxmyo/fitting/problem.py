"""What is fitted: a function from named parameters to predictions, the numbers observed, and their weights."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.fitting.parameters import Parameter

#: Named values (scalars) → predictions (n,); NaN where a state was not found.
Predict = Callable[[dict[str, Array]], Array]

#: What takes the place of the residual of a state that was not found [–, times the spread of the observations].
MISSED = 1e3


@dataclass(frozen=True, eq=False)
class Problem:
    """Predictions against observations.

    predict: a pure function of a dictionary of named scalars, (n,) in the units of `observed`, NaN where a state was
    not found; observed: (n,); parameters: all that predict takes, free or fixed; free: names of those that are fitted;
    weight: (n,) of the squared residuals, 0 for an observation that is held out; groups: (n,) the protocol of each;
    unit: of the observations; staged: whether predict runs inside `jit` and `vmap`, as it does but for sparse solves of
    large bodies; about: what makes the problem again, for the record.

    Errors: ValueError for arrays of other lengths, non-finite observations, unknown names, not more
    observations than free parameters.
    """

    predict: Predict
    observed: NDArray[np.float64]
    parameters: tuple[Parameter, ...]
    free: tuple[str, ...]
    weight: Any = None
    groups: tuple[str, ...] = ()
    unit: str = "kPa"
    staged: bool = True
    about: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        observed = checks.concrete("observed", self.observed, (None,))
        n = len(observed)
        weight = np.ones(n) if self.weight is None else checks.concrete("weight", self.weight, (n,))
        if (weight < 0.0).any():
            raise ValueError(f"weight must be ≥ 0; got {weight.min():g} at index {int(weight.argmin())}")
        groups = tuple(self.groups) or ("all",) * n
        if len(groups) != n:
            raise ValueError(f"groups must have one name per observation ({n}); got {len(groups)}")
        names = [p.name for p in self.parameters]
        for name in self.free:
            checks.choice("free", name, names)
        if len(set(self.free)) < len(self.free) or len(set(names)) < len(names):
            raise ValueError(f"a name stands twice in free = {self.free} or parameters = {names}")
        if not self.free:
            raise ValueError(f"free is empty: nothing to fit; name some of {', '.join(names)}")
        if (used := int((weight > 0.0).sum())) <= len(self.free):
            raise ValueError(
                f"{len(self.free)} free parameters ({', '.join(self.free)}) need more observations with a weight than "
                f"{used}: fix some"
            )
        for key, value in {"observed": observed, "weight": weight, "groups": groups, "free": tuple(self.free)}.items():
            object.__setattr__(self, key, value)
        for p in self.fitted:
            p.x(p.value)

    def __getitem__(self, name: str) -> Parameter:
        return self.parameters[[p.name for p in self.parameters].index(name)]

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """The free parameters, in the order of `free`."""
        return tuple(self[name] for name in self.free)

    @property
    def n(self) -> int:
        """The number of observations with a weight."""
        return int((self.weight > 0.0).sum())

    def starting_at(self, **values: float) -> "Problem":
        """The same problem with other values of some parameters."""
        for name in values:
            checks.choice("parameter", name, [p.name for p in self.parameters])
        return replace(
            self, parameters=tuple(replace(p, value=float(values.get(p.name, p.value))) for p in self.parameters)
        )

    def fitting(self, *free: str) -> "Problem":
        """The same problem with other parameters free."""
        return replace(self, free=free)

    def without(self, *groups: str) -> "Problem":
        """The same problem with some protocols held out: their weight is 0."""
        for name in groups:
            checks.choice("protocol", name, list(dict.fromkeys(self.groups)))
        held = np.isin(np.array(self.groups), groups)
        return replace(self, weight=np.where(held, 0.0, self.weight))


def log_likelihood(problem: Problem, values: Mapping[str, Any], sd: Any) -> Array:
    """ln of the probability density of the observations: independent Gaussian errors, variance sd² / weight.

    Σ −½ w r² / sd² − ½ ln(2π sd² / w) over the observations with a weight; −∞ where a state was not found or a value is
    outside of its bounds. values: by name, those that are missing are the problem's; sd: standard deviation in the unit
    of the observations. Pure: it runs under jit, vmap and grad, so that a sampler (numpyro, blackjax) runs on it.
    """
    known: dict[str, Array] = {p.name: jnp.asarray(p.value, dtype=float) for p in problem.parameters}
    for name in values:
        checks.choice("parameter", name, list(known))
    known |= {name: jnp.asarray(v, dtype=float) for name, v in values.items()}
    inside = [(p.low <= known[p.name]) & (known[p.name] <= p.high) for p in problem.parameters]
    predicted = problem.predict(known)
    used = np.asarray(problem.weight) > 0.0
    found = jnp.isfinite(predicted)
    w = jnp.asarray(np.where(used, problem.weight, 1.0))
    r = jnp.where(found, predicted, 0.0) - problem.observed
    sd = jnp.asarray(sd, dtype=float)
    terms = -0.5 * w * (r / sd) ** 2 - 0.5 * jnp.log(2.0 * jnp.pi * sd**2 / w)
    possible = jnp.all(found | ~used) & jnp.all(jnp.stack(inside)) & (sd > 0.0)
    return jnp.where(possible, jnp.sum(jnp.where(used, terms, 0.0)), -jnp.inf)


def spread(observed: NDArray[np.float64]) -> float:
    """A size of the observations: their root mean square, 1 if they are all zero."""
    return float(np.sqrt(np.mean(observed**2))) or 1.0
