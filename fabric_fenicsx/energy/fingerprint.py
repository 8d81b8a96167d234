"""Attributes of objects as plain data, which a checkpoint compares."""

import tomllib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from ..io.field import Field
from ..material.laws.base import Material
from ..surfaces.surfaces import Surface
from ..surfaces.tool import Tool

Plain = Any  # what JSON can hold


def plain(value: Plain) -> Plain:
    """`value` as JSON can hold it, numbers to 12 digits; of tools surface, path and force at half
    and full load; of functions, other objects and arrays of more than 100 numbers, which may be of
    a rank's own nodes, only their type."""
    if isinstance(value, fem.Constant):
        value = value.value
    if isinstance(value, (np.ndarray, np.generic)) and value.size <= 100:
        value = value.tolist()
    if isinstance(value, float):
        return float(f"{value:.12g}") if np.isfinite(value) else str(value)
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    if isinstance(value, Material):
        return value.dumps()
    if isinstance(value, Field):
        return f"points {value.content}" if value.content else "a function"
    kind = type(value).__name__
    if isinstance(value, Tool):
        moves = {"path": value.path, "force": value.force}
        at = {k: [np.asarray(f(load)) for load in (0.5, 1.0)] for k, f in moves.items() if f}
        return plain({"name": value.name, "surface": value.surface} | at)
    if isinstance(value, Surface):
        return {"kind": kind} | plain(value.fingerprint())
    if is_dataclass(value) and not isinstance(value, type):
        return plain({field.name: getattr(value, field.name) for field in fields(value)})
    return kind


def of_values(comm: MPI.Comm, x: np.ndarray, values: np.ndarray) -> list[float]:
    """What tells values (n, k) at places x (n, 3) of all ranks from others, the same on any number
    of ranks: means, also times waves over the places, over the largest value."""
    largest = comm.allreduce(float(abs(values).max(initial=0.0)), MPI.MAX) or 1.0
    waves = np.cos(x @ np.sqrt([[2.0, 11.0], [3.0, 13.0], [5.0, 17.0]]) / 50.0)
    weights = np.column_stack([np.ones(len(x)), waves])
    sums = comm.allreduce(np.append((weights.T @ values / largest).ravel(), len(x)), MPI.SUM)
    return [float(f"{largest:.9g}"), *np.round(sums[:-1] / sums[-1], 9).tolist()]


def entries(value: Plain, path: str) -> dict[str, Plain]:
    """Plain data by the dotted path of each entry, also of those in material files' texts:
    {"material.yarns.b": 667.5}."""
    if isinstance(value, str) and "\n" in value:
        try:
            value = tomllib.loads(value)
        except tomllib.TOMLDecodeError:  # texts of several materials
            return {path: value}
    if isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
        value = dict(enumerate(value, 1))
    if not isinstance(value, Mapping):
        return {path: value}
    parts = (entries(entry, f"{path}.{name}") for name, entry in value.items())
    return {key: number for part in parts for key, number in part.items()}


def of_attributes(thing: object) -> dict[str, Plain]:
    """Attributes of an object as plain data, {name: value}."""
    attributes: dict[str, Plain] = {}
    for name, value in vars(thing).items():
        attributes |= value if isinstance(value, Mapping) else {name.lstrip("_"): value}
    return plain(attributes)
