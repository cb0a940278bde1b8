"""The result of a study: named outputs over named axes, each with its unit, and the status of every sample."""

import csv
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.files import whole
from jaxmyo.status import MEANING, Status
from jaxmyo.studies import quantities, sensitivity
from jaxmyo.studies.design import Design, Numbers, size
from jaxmyo.studies.evaluation import DERIVATIVE_STATUS, STATUS, derivative_name

ROWS = 10_000  # of a CSV file at a time


@dataclass(frozen=True, repr=False)
class Study:
    """What a study found.

    design: the points, a `Grid` or a `Sample`; units: of parameters, outputs and derivatives, by their names; values:
    name of an output → float64 array (*shape, *shape of the output), `study["lambda_f"]` for short; shape is that of
    the grid, one dimension per axis in their order, or (n,) of a sample; status: int8 (*shape), see `Status`. Where it
    is not CONVERGED (0) the sample failed: its outputs are NaN (missing values), and `failures()` says why.
    derivatives and their status: by names as "d_lambda_f_d_T0", NaN where there is none, see `derivative`.
    """

    design: Design
    units: dict[str, str]
    values: dict[str, Numbers]
    status: NDArray[np.int8]
    derivatives: dict[str, Numbers]
    derivative_status: NDArray[np.int8] | None

    @property
    def axes(self) -> dict[str, Numbers]:
        """Name → values of each axis of a grid, or of the points of a sample."""
        return self.design.axes

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the grid, or (n,)."""
        return tuple(self.design.dims.values())

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Which samples are good."""
        return np.asarray(self.status == Status.CONVERGED)

    def __getitem__(self, name: str) -> Numbers:
        """The values of an output, or of a derivative, by its name."""
        every = self.values | self.derivatives
        return every[checks.choice("name", name, list(every))]

    def derivative(self, output: str, parameter: str) -> Numbers:
        """∂output/∂parameter [unit of one by the other] at every sample, by implicit differentiation.

        NaN where the sample failed or its tangent is singular; `derivative_status` says which.
        """
        return self[derivative_name(output, parameter)]

    def elasticity(self, output: str, parameter: str) -> Numbers:
        """x/y ∂y/∂x [–]: percent of y per percent of x. NaN where there is no derivative, and where y = 0."""
        slope, y = self.derivative(output, parameter), self[output]
        x = self._parameter(parameter).reshape(*self._parameter(parameter).shape, *(1,) * (y.ndim - len(self.shape)))
        return np.divide(x * slope, y, out=np.full(y.shape, np.nan), where=y != 0.0)

    def sobol_indices(self, output: str, confidence: float = 0.95) -> dict[str, sensitivity.Sobol]:
        """First-order and total Sobol indices [–] of an output by each parameter, with bootstrap intervals.

        Of a study over a `saltelli_sample`. `scipy.stats.sobol_indices`, the estimators of Saltelli et al. 2010, Comput
        Phys Commun 181:259–270. A ValueError if a sample failed, since the rest would be a biased one.
        """
        y = self.values[checks.choice("output", output, list(self.values))]
        return sensitivity.sobol(self.design, y, self.converged, confidence)

    def failures(self) -> str:
        """How many samples failed, of which kind, where the first of each is, and what that means."""
        lines = []
        for value in np.unique(self.status[~self.converged]):
            which = np.flatnonzero(self.status == value)
            kind = Status(int(value))
            where = self.design.points(which[:1].astype(np.int64))
            at = ", ".join(f"{n} = {x[0]:g}" + _spaced(self.units[n]) for n, x in where.items())
            lines.append(f"{len(which)} {kind.name}, the first at {at}: {MEANING[kind]}")
        return "\n".join(lines) or "every sample converged"

    def __repr__(self) -> str:
        dims = " × ".join(f"{name} {n}" for name, n in self.design.dims.items()) or "one point"
        good = int(self.converged.sum())
        lines = [f"Study of {size(self.design)} samples ({self.design.kind}: {dims}), {good} converged"]
        for name, x in self.values.items():
            good_ones = x[self.converged]
            span = f"{good_ones.min():.6g} to {good_ones.max():.6g}" if good_ones.size else "no value"
            lines.append(f"  {name} [{self.units[name]}]: {span}")
        if good < self.status.size:
            lines.append(self.failures())
        return "\n".join(lines)

    def to_xarray(self) -> Any:
        """An `xarray.Dataset` with named dimensions, coordinates and units; failed samples are NaN beside `status`."""
        try:
            import xarray
        except ModuleNotFoundError as error:
            raise checks.missing(error, "to_xarray needs", "'jaxmyo[study]'") from error
        variables = {name: (dims, x, attributes) for name, dims, x, attributes in self._variables()}
        names = [*self.axes, *self.design.fixed]
        return xarray.Dataset(
            {name: v for name, v in variables.items() if name not in names},
            {name: variables[name] for name in names},
            {"design": self.design.kind},
        )

    def to_netcdf(self, path: str | Path) -> Path:
        """A NetCDF file (version 3 with 64-bit offsets): variables over named dimensions, with units and flags."""
        from scipy.io import netcdf_file

        with whole(path) as beside, netcdf_file(beside, "w", version=2) as file:
            file.design = self.design.kind
            others = " ".join(n for n in (*self.axes, *self.design.fixed) if n not in self.design.dims)
            for name, dims, x, attributes in self._variables():
                if others and name not in (*self.axes, *self.design.fixed):
                    attributes = {**attributes, "coordinates": others}  # CF: coordinates that are no dimensions
                for dim, n in zip(dims, x.shape, strict=True):
                    if dim not in file.dimensions:
                        file.createDimension(dim, n)
                variable = file.createVariable(name, x.dtype, dims)
                variable[...] = x
                for key, value in attributes.items():
                    setattr(variable, key, value)
        return Path(path)

    def to_csv(self, path: str | Path) -> Path:
        """A CSV file: a row per sample, units in the names of the columns, numbers in full, failed ones empty."""
        n = size(self.design)
        flat = {name: x.reshape(n, -1) for name, x in (self.values | self.derivatives).items()}
        columns = [quantities.column(name, self.units[name]) for name in (*self.axes, *self.design.fixed)]
        for name, x in flat.items():
            inner = np.ndindex((self.values | self.derivatives)[name].shape[len(self.shape) :])
            suffixes = ["_".join(map(str, index)) for index in inner] if x.shape[1] != 1 else [""]
            columns += [quantities.column(f"{name}_{s}" if s else name, self.units[name]) for s in suffixes]
        statuses = [self.status] if self.derivative_status is None else [self.status, self.derivative_status]
        columns += [STATUS, DERIVATIVE_STATUS][: len(statuses)]
        with whole(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for begin in range(0, n, ROWS):
                index = np.arange(begin, min(begin + ROWS, n))
                points = self.design.points(index)
                numbers = [points[name] for name in (*self.axes, *self.design.fixed)]
                numbers += [x[index, j] for x in flat.values() for j in range(x.shape[1])]
                cells = [["" if v != v else repr(v) for v in column.tolist()] for column in numbers]
                cells += [[Status(v).name for v in s.reshape(-1)[index].tolist()] for s in statuses]
                writer.writerows(zip(*cells, strict=True))
        return Path(path)

    def _parameter(self, name: str) -> Numbers:
        """The values of a parameter, in the shape of the study or ready to be broadcast to it."""
        if name in self.design.fixed:
            return np.full(self.shape, self.design.fixed[name])
        dims = list(self.design.dims)
        if name not in dims:
            return self.axes[name]
        ones = [1] * len(dims)
        ones[dims.index(name)] = -1
        return np.broadcast_to(self.axes[name].reshape(ones), self.shape)

    def _variables(self) -> Iterator[tuple[str, tuple[str, ...], NDArray[Any], dict[str, Any]]]:
        """Name, dimensions, values and attributes of everything, as datasets and files have them."""
        dims = tuple(self.design.dims)
        for name, x in self.axes.items():
            yield name, (name,) if name in dims else dims, x, {"units": quantities.plain(self.units[name])}
        for name, number in self.design.fixed.items():
            yield name, (), np.array(number), {"units": quantities.plain(self.units[name])}
        for name, x in (self.values | self.derivatives).items():
            inner = tuple(f"{name}_{k}" for k in range(x.ndim - len(dims)))
            yield name, (*dims, *inner), x, {"units": quantities.plain(self.units[name])}
        flags = {
            "flag_values": np.array([s.value for s in Status], dtype=np.int8),
            "flag_meanings": " ".join(s.name for s in Status),
        }
        yield STATUS, dims, self.status, flags
        if self.derivative_status is not None:
            yield DERIVATIVE_STATUS, dims, self.derivative_status, flags


def assemble(design: Design, units: dict[str, str], arrays: dict[str, NDArray[Any]], slopes: Collection[str]) -> Study:
    """A study from flat arrays (n, ...) by name; slopes: the names of the derivatives among them."""
    shape = tuple(design.dims.values())
    shaped = {name: x.reshape((*shape, *x.shape[1:])) for name, x in arrays.items()}
    status = shaped.pop(STATUS)
    derivative_status = shaped.pop(DERIVATIVE_STATUS, None)
    return Study(
        design=design,
        units=units,
        values={name: x for name, x in shaped.items() if name not in slopes},
        status=status,
        derivatives={name: x for name, x in shaped.items() if name in slopes},
        derivative_status=derivative_status,
    )


def _spaced(unit: str) -> str:
    return "" if unit == "–" else f" {unit}"
