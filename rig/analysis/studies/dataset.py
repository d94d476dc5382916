"""The result of a study as xarray's Dataset, and as a file: NetCDF or Zarr."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.analysis.studies.plan import REPEAT, SAMPLE
from rig.errors import OutputError, UsageError
from rig.extras import needed
from rig.user_files import write_file

if TYPE_CHECKING:
    from xarray import Dataset

    from rig.analysis.studies.result_data import StudyData

SUFFIXES = (".nc", ".zarr")


def dataset(found: StudyData) -> Dataset:
    """Return measures, seed and reason over the keys of the grid, sample and repeat; drawn values over sample.

    Every variable has `units` in SI and `long_name`; attributes state scene, plan and provenance. Raises UsageError if
    xarray is not installed.
    """
    xarray: Any = needed("xarray", "data")
    plan = found.work.plan
    names, shape = tuple(plan.dimensions), tuple(plan.dimensions.values())
    coordinates: dict[str, Any] = {
        one.key: ((one.key,), np.array(one.axis.values), _about(one.axis.unit, one.axis.words)) for one in plan.grid
    }
    for i, one in enumerate(plan.drawn):
        about = _about(one.axis.unit, one.axis.words) | {"distribution": str(one.distribution)}
        coordinates[one.key] = ((SAMPLE,), plan.draws[:, i], about)
    if plan.repeat > 1:
        coordinates[REPEAT] = ((REPEAT,), np.arange(plan.repeat))
    variables: dict[str, Any] = {
        _name(name): (names, found.values_of(name), _about(unit, name)) for name, unit in zip(found.names, found.units)
    }
    seeds = np.array([plan.seed_of(k) for k in range(plan.total)])
    variables["seed"] = (names, seeds.reshape(shape), {"long_name": "seed of the run"})
    variables["reason"] = (names, np.array(found.reasons, dtype=object).reshape(shape),
                           {"long_name": "why a value is missing"})  # fmt: skip
    attributes: dict[str, Any] = {f"provenance_{name}": text for name, text in found.provenance.items()}
    attributes |= {"scene": found.work.scene.name, "sampling": plan.sampling, "study_seed": plan.seed,
                   "scene_json": found.work.scene.to_json(), "measures": json.dumps(found.names)}  # fmt: skip
    made: Dataset = xarray.Dataset(variables, coordinates, attributes)
    for one in made.coords.values():
        one.encoding["_FillValue"] = None  # CF allows no missing values in a coordinate
    return made


def check_path(path: Path) -> None:
    """Raise UsageError for what `save` could not write: another suffix, another folder, or a missing library."""
    if path.suffix not in SUFFIXES:
        raise UsageError(f"--to {path}: the name ends in .nc (NetCDF) or .zarr (Zarr)")
    if path.suffix == ".zarr" and path.exists() and not (path / "zarr.json").is_file():
        raise UsageError(
            f"--to {path}: there is a file or folder of this name that is no Zarr folder; name another one"
        )
    needed("xarray", "data")
    if path.suffix == ".nc":
        needed("h5netcdf", "data")
    elif importlib.util.find_spec("zarr") is None:
        raise UsageError(
            "zarr is not installed; pip install zarr installs it, or write NetCDF: a name that ends in .nc"
        )


def save(found: StudyData, path: Path) -> None:
    """Write the Dataset to a file .nc or a folder .zarr, completely or not at all. Raises UsageError, OutputError."""
    check_path(path)
    made = dataset(found)
    try:
        if path.suffix == ".zarr":
            _zarr(made, path)
            return
        made["scene_json"] = ((), made.attrs.pop("scene_json"))  # HDF5 limits attributes to 64 KiB
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, bytes(made.to_netcdf(engine="h5netcdf")))  # on its own HDF5 tells a full disk in four lines
    except OSError as fault:
        raise OutputError(f"{path} cannot be written: {fault.strerror or fault}") from None


def _zarr(made: Dataset, path: Path) -> None:
    draft = path.with_name(f".{path.name}.part")
    shutil.rmtree(draft, ignore_errors=True)
    try:
        made.to_zarr(draft, mode="w", consolidated=False)  # version 3 of the format has no consolidated metadata
        shutil.rmtree(path, ignore_errors=True)
        draft.rename(path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _about(unit: str, words: str) -> dict[str, str]:
    return {"units": unit or "1", "long_name": words}


def _name(measure: str) -> str:
    """A measure as the name of a variable: NetCDF allows no slash."""
    return measure.replace("/", "_")
