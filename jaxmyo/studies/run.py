"""`study`: chunk by chunk, over all the devices, threads and processes that there are; resumable if it has a folder."""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import partial
from importlib.metadata import version
from pathlib import Path
from threading import Semaphore
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from numpy.typing import NDArray

from jaxmyo import checks
from jaxmyo.fingerprint import fingerprint, hash_of
from jaxmyo.progress import LOG
from jaxmyo.studies import store
from jaxmyo.studies.design import Design, Grid, Sample, as_design, size
from jaxmyo.studies.evaluation import Evaluation, Outputs, Solve
from jaxmyo.studies.result import Study, assemble
from jaxmyo.studies.store import Store

#: Points that are solved together, if they are small, and the bytes that larger ones may take.
CHUNK, MEMORY = 1024, 2**28

#: Of these so many run in step: all of them wait for the slowest, and more would not stay in the cache.
STEP = 64

#: Where several programs run at a time on a CPU, each runs in one thread: faster than to split many small operations.
ALONE: dict[str, str | bool] = {"xla_cpu_multi_thread_eigen": False}

Arrays = dict[str, NDArray[Any]]
Run = Callable[[Sequence[int]], list[Arrays]]


def study(
    solve: Solve,
    axes: Mapping[str, Any] | Sample,
    outputs: Outputs = None,
    *,
    units: Mapping[str, str] | None = None,
    derivatives: bool | Sequence[str] = False,
    out: str | Path | None = None,
    chunk: int | None = None,
    progress: bool = False,
) -> Study:
    """Outputs of a solve over a grid, or over a sample, of named parameters; a status for each, none disturbs another.

    solve: a function of named scalars that JAX can trace, which returns a `State`, several states (a tuple or mapping,
    in the order in which they are solved), or a mapping from names to outputs with states or a "status" beside them. A
    `Scene` stands for its free contraction, by T0, a_over_D, beta, weave_stiffness and the constants of its law.
    axes: name → values (1-D) of each axis of a grid; a number keeps a parameter fixed; or a `Sample`, as
    `sobol_sample` draws it.
    outputs: names of what every state has (lambda_f, lambda_cf, lambda_n, sigma_f, sigma_cf, sigma_n, T_f, T_cf:
    volume means, of the last state; stored_energy, residual, negative_eigenvalues), or a mapping from names to such
    names and to functions of what solve returns, scalars or arrays of fixed shape. Left out: all of them.
    units: of parameters and outputs that are not known here, as {"pressure": "kPa", "radius": "mm"}; "–" for a number.
    derivatives: by which parameters, True for all: every output has its derivatives too, see `Study.derivative`.
    out: a folder, made if it is not there, in which each chunk is written as soon as it is computed. The same call on a
    folder with a part of the study computes what is missing, and gives what one uninterrupted run does, bit for bit.
    chunk: points that are solved together in one compiled program, which bounds the memory; the last chunk is filled
    up. progress: show a bar (tqdm).

    All devices that JAX has here take part; so do all processes of `jax.distributed`, for which `out` is a folder that
    all of them see. Bodies that are solved by sparse factors are solved one by one.
    Errors: ValueError or TypeError for names, ranges, units and outputs that are wrong, before anything is solved, and
    for a folder that has another study, with what differs.
    """
    design = as_design(axes)
    names = (*design.axes, *design.fixed)
    by = names if derivatives is True else () if derivatives is False else tuple(derivatives)
    evaluation = Evaluation(solve, names, outputs, by)
    every_unit = evaluation.units(units or {})
    n = size(design)
    chunk = _chunk(chunk, evaluation, n)
    rank, processes = jax.process_index(), jax.process_count()
    kept = None
    if out is not None:
        manifest = _manifest(design, evaluation, every_unit, chunk)
        store.begin(Path(out), manifest, {**design.axes, **_arrays_of(design.fixed)}, writes=rank == 0)
        kept = Store(Path(out), evaluation.shapes, n, chunk)
    elif processes > 1:
        raise ValueError(f"out: {processes} processes need a folder, which all of them see, to put a study together")
    chunks = range(math.ceil(n / chunk))
    todo = list(chunks) if kept is None else kept.missing()
    if len(todo) < len(chunks):
        LOG.info("study: %d of %d chunks are in %s", len(chunks) - len(todo), len(chunks), out)
    found = _empty(evaluation.shapes, n) if kept is None else {}

    def put(k: int, arrays: Arrays) -> None:
        if kept is not None:
            kept.write(k, arrays)
            return
        for name, x in arrays.items():
            found[name][k * chunk : (k + 1) * chunk] = x

    own = [k for k in todo if k % processes == rank]  # not by its place in todo, which others may see shorter
    _work(evaluation, design, chunk, own, put, progress)
    if kept is None:
        return assemble(design, every_unit, found, evaluation.slopes)
    kept.wait()
    if rank == 0:
        kept.tidy()
    return _read(design, every_unit, kept, _empty(evaluation.shapes, n), chunk, evaluation.slopes)


def load_study(out: str | Path) -> Study:
    """The study in a folder, without what computed it.

    Errors: FileNotFoundError; ValueError for a study that is not finished, or a file that is damaged.
    """
    folder = Path(out)
    manifest = store.read_manifest(folder)
    values = store.read_axes(folder)
    kind = manifest["design"]
    design = Grid(values) if kind == "grid" else Sample(values, kind)
    if lines := list(store.differences({part: manifest[part] for part in ("axes", "fixed")}, _axes_of(design))):
        raise ValueError(f"{folder / store.AXES} is of another study; it differs in:\n  " + "\n  ".join(lines))
    shapes = {
        name: jax.ShapeDtypeStruct(tuple(s["shape"]), np.dtype(s["dtype"])) for name, s in manifest["outputs"].items()
    }
    n, chunk = size(design), manifest["chunk"]
    kept = Store(folder, shapes, n, chunk)
    if missing := kept.missing():
        raise ValueError(
            f"the study in {folder} is not finished: {len(missing)} of {math.ceil(n / chunk)} chunks are missing. Call "
            "`study` as it was begun to go on"
        )
    return _read(design, manifest["units"], kept, _empty(shapes, n), chunk, manifest["derivatives"])


def _work(
    evaluation: Evaluation,
    design: Design,
    chunk: int,
    todo: list[int],
    put: Callable[[int, Arrays], None],
    progress: bool,
) -> None:
    """Compute these chunks: a group of them at a time, one for each device, in as many threads as are of use."""
    bar = _bar(sum(min(chunk, size(design) - k * chunk) for k in todo)) if progress else None
    if not todo:
        return
    n = size(design)
    devices, workers = ([], 1) if evaluation.large else _share(jax.local_devices(), evaluation.lapack)
    width = max(1, len(devices))
    options = ALONE if width * workers > 1 and devices[0].platform == "cpu" else None
    run = _batched(evaluation, design, chunk, devices, options) if devices else _one_by_one(evaluation, design)
    workers = min(workers, math.ceil(len(todo) / width))

    computing = Semaphore(workers)

    def group(ks: list[int]) -> None:
        with computing:
            found = run(ks)
        for k, arrays in zip(ks, found, strict=True):
            real = min(chunk, n - k * chunk)
            put(k, {name: x[:real] for name, x in arrays.items()})
            if bar is not None:
                bar.update(real)

    with ThreadPoolExecutor(workers + 1) as pool:  # one writes while the others compute
        futures = [pool.submit(group, todo[i : i + width]) for i in range(0, len(todo), width)]
        try:
            done, _ = wait(futures, return_when=FIRST_EXCEPTION)
            for future in done:
                future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            if bar is not None:
                bar.close()


def _share(devices: list[Any], lapack: bool) -> tuple[list[Any], int]:
    """The devices that work, and the number of programs that each has at a time.

    On a CPU a program takes a thread of XLA's pool, which has one per core (or device). In jaxlib 0.10 a batched call
    of LAPACK waits there for other threads, and if the whole pool waits, it does so for ever; so half stays free.
    """
    if devices[0].platform != "cpu":
        return devices, 2  # the second keeps the queue filled
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    pool = max(cores, len(devices))
    programs = max(1, pool // 2) if lapack else pool
    working = devices[:programs]
    return working, max(1, min(programs, cores) // len(working))


def _batched(
    evaluation: Evaluation, design: Design, chunk: int, devices: Sequence[Any], options: dict[str, str | bool] | None
) -> Run:
    """Chunks as one compiled program, one chunk on each device; a chunk's numbers do not depend on where it runs."""
    n, width = size(design), len(devices)
    batch: Any = partial(jax.lax.map, evaluation, batch_size=STEP if chunk % STEP == 0 else chunk)
    if width > 1:
        along = PartitionSpec("devices")
        batch = jax.shard_map(
            batch, mesh=Mesh(np.array(devices), ("devices",)), in_specs=along, out_specs=along, check_vma=False
        )
    shape = jax.ShapeDtypeStruct((width * chunk,), np.float64)
    program = jax.jit(batch).lower(dict.fromkeys(evaluation.names, shape)).compile(options)

    def run(ks: Sequence[int]) -> list[Arrays]:
        filled = [*ks, *[ks[-1]] * (width - len(ks))]
        index = np.concatenate([np.arange(k * chunk, (k + 1) * chunk) for k in filled])
        found = jax.device_get(program(design.points(np.minimum(index, n - 1))))
        return [{name: x[i * chunk : (i + 1) * chunk] for name, x in found.items()} for i in range(len(ks))]

    return run


def _one_by_one(evaluation: Evaluation, design: Design) -> Run:
    def run(ks: Sequence[int]) -> list[Arrays]:
        points = design.points(np.asarray(ks, dtype=np.int64))
        each = [evaluation.one({name: float(x[i]) for name, x in points.items()}) for i in range(len(ks))]
        return [{name: x[None] for name, x in one.items()} for one in each]

    return run


def _chunk(given: int | None, evaluation: Evaluation, n: int) -> int:
    if given is not None and (isinstance(given, bool) or int(given) != given or given < 1):
        raise ValueError(f"chunk = {given} must be an integer ≥ 1, the points that are solved together")
    if evaluation.large:
        if given not in (None, 1):
            raise ValueError(f"chunk = {given}: a body of this size is solved by sparse factors, one point at a time")
        return 1
    if given is not None:
        return int(given)
    of_one = 2**13 + 80 * evaluation.unknowns**2  # bytes: ten matrices of the dense Newton loop, and the rest
    return min(CHUNK, 2 ** max(0, int(math.log2(MEMORY / of_one))), 2 ** math.ceil(math.log2(n)))


def _manifest(design: Design, evaluation: Evaluation, units: dict[str, str], chunk: int) -> dict[str, Any]:
    """What the study is, as JSON."""
    return {
        "format": store.FORMAT,
        "version": store.VERSION,
        "design": design.kind,
        **_axes_of(design),
        "outputs": {n: {"shape": list(s.shape), "dtype": s.dtype.name} for n, s in evaluation.shapes.items()},
        "derivatives": list(evaluation.slopes),
        "units": units,
        "chunk": chunk,
        "scenes": {str(i): fingerprint(scene) for i, scene in enumerate(evaluation.scenes)},
        "program of solve and outputs": evaluation.program,
        "versions": {package: version(package) for package in ("jaxmyo", "jax", "jaxlib")},
        "platform": jax.local_devices()[0].platform,
    }


def _axes_of(design: Design) -> dict[str, Any]:
    """The axes, their values as a hash, and the parameters that stay, as JSON."""
    axes = {name: {"n": len(x), "first": x[0], "last": x[-1], "values": hash_of(x)} for name, x in design.axes.items()}
    return {"axes": axes, "fixed": design.fixed}


def _arrays_of(fixed: Mapping[str, float]) -> Arrays:
    return {name: np.array(x) for name, x in fixed.items()}


def _empty(shapes: store.Shapes, n: int) -> Arrays:
    return {name: np.empty((n, *s.shape), s.dtype) for name, s in shapes.items()}


def _read(
    design: Design, units: dict[str, str], kept: Store, arrays: Arrays, chunk: int, slopes: Sequence[str]
) -> Study:
    for k in range(math.ceil(size(design) / chunk)):
        for name, x in kept.read(k).items():
            arrays[name][k * chunk : (k + 1) * chunk] = x
    return assemble(design, units, arrays, slopes)


def _bar(total: int) -> Any:
    try:
        from tqdm import tqdm
    except ModuleNotFoundError as error:
        raise checks.missing(error, "a progress bar needs", "'jaxmyo[study]'") from error
    return tqdm(total=total, unit=" samples")
