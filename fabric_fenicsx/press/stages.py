"""The stages of a press: which tools move, and how, one stage after the other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..core.errors import InputError
from ..core.fields import KnowsItsFields, documented, flag, quantity
from ..core.rules import COUNT, FINITE, FROM_ZERO, POSITIVE, unknown_key
from ..core.tables import as_table
from ..surfaces.surfaces import checked_vector
from .holders import Holder, PressureHolder
from .tools import PressTool


@documented
@dataclass(frozen=True)
class Stage(KnowsItsFields):
    """Motions, forces and pressures in one part of a run, in proportion to the load: one of them
    must do something.

    - name: in results
    - moves: {name of a tool: distance towards the blank, or a vector (3,)} [mm]; a distance below 0
      is away from it
    - forces: {name of a tool that a force moves: force on the whole blank at the end of the stage}
      [N]
    - pressures: {name of a holder with a pressure: pressure at the end of the stage} [MPa]
    - leave: names of tools that go back to where they started

    Examples
    --------
    >>> ff.Stage("forming", moves={"punch": 40}, steps=20).moves["punch"]
    40
    """

    name: str = ""
    moves: Mapping[str, float | Sequence[float]] = field(default_factory=dict)
    close: float | None = quantity(
        None, POSITIVE, "final distance between tools and their dies [thicknesses of the blank]"
    )
    forces: Mapping[str, float] = field(default_factory=dict)
    pressures: Mapping[str, float] = field(default_factory=dict)
    leave: Sequence[str] = ()
    steps: int = quantity(20, COUNT, "load steps")
    unload: bool = flag("remove all tools and holders; only in the last stage")

    def __post_init__(self) -> None:
        super().__post_init__()
        for kind, rule in (("moves", FINITE), ("forces", POSITIVE), ("pressures", FROM_ZERO)):
            for name, value in as_table(getattr(self, kind), f"`{kind}`", "a table").items():
                is_vector = kind == "moves" and np.ndim(value) == 1
                (checked_vector if is_vector else rule.check)(f"`{kind}`.{name}", value)
        moves, leaves = any(map(np.any, self.moves.values())), isinstance(self.leave, (list, tuple))
        acts = bool(moves or self.forces or self.pressures or self.leave or self.close)
        if self.unload == acts or not leaves:
            raise InputError(
                "a stage needs `moves` other than 0, `close`, `forces`, `pressures` or `leave`, a "
                "list of names of tools; or `unload` alone"
            )


class Schedule:
    """What tools and holders do over the load factor, from 0 to 1 over all `stages` in proportion
    to their steps; `joints`: load factors at their ends.

    reach: {name of a tool with a die: distance that it moves until it touches the die} [mm];
    thickness: of the blank [mm]. Raises InputError for stages that name what is not there.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        tools: Mapping[str, PressTool],
        holders: Mapping[str, Holder | Sequence[Holder]],
        reach: Mapping[str, float],
        thickness: float,
    ) -> None:
        self._tools, self._reach, self._thickness = tools, reach, thickness
        self.unloads = bool(stages[-1].unload)
        forming = stages[:-1] if self.unloads else stages
        if not forming or any(stage.unload for stage in forming):
            flaw = "stage needs at least one forming stage, [[stage]]"
            raise InputError(f"{flaw}; `unload` is allowed only in the last")
        self.stages = [replace(s, name=s.name or f"stage {k}") for k, s in enumerate(forming, 1)]
        self.steps = sum(stage.steps for stage in self.stages)
        self.joints = np.append(0, np.cumsum([s.steps for s in self.stages])) / self.steps
        # places of tools from the start, forces of tools and pressures of holders, at the joints
        self._places = {name: [np.zeros(3)] for name in tools}
        self._forces = {n: [t.force] for n, t in tools.items() if t.force is not None}
        self._pressures = {
            name: [holder.pressure]
            for name, holder in holders.items()
            if isinstance(holder, PressureHolder) and not callable(holder.pressure)
        }
        for stage in self.stages:
            self._add(stage, f"stage.{stage.name.removeprefix('stage ')}")
        for name in tools:
            if min(gone := self._gone(name)) < 0 and max(gone) <= 0:
                flaw = f"tools.{name} moves only away from the blank"
                raise InputError(f"{flaw}; expected numbers above 0 in `moves`, towards it")

    def _add(self, stage, label):
        flaws = list[str]()
        of_kind = (
            ("force", stage.forces, self._forces),
            ("pressure", stage.pressures, self._pressures),
        )
        for kind, given, series in of_kind:
            flaws += [
                f"{label}.{kind}s.{name} needs a `{kind}` from the start; those that have one are "
                f"{', '.join(series) or 'none here'}"
                for name in given
                if name not in series
            ]
            for name, values in series.items():
                values.append(given.get(name, values[-1]))
        moves, moved = dict(stage.moves), [*stage.moves, *stage.leave]
        if stage.close is not None:
            left = stage.close * self._thickness
            moves |= {n: reach - left - self._gone(n)[-1] for n, reach in self._reach.items()}
            moved += self._reach
            flaws += [] if self._reach else [f"{label}.close needs a tool with a die, as die_of"]
        for name in moved:
            if name not in self._tools:
                raise unknown_key(name, self._tools, f"{label}: tool {name}")
            if name in self._forces or moved.count(name) > 1:
                flaws.append(
                    f"{label} moves {name} twice; a tool moves by its force, in `forces`, or by "
                    "one of `moves`, `close` and `leave`"
                )
        if flaws:
            raise InputError(flaws[0])
        for name, places in self._places.items():
            move = np.asarray(moves.get(name, 0.0), dtype=float)
            along = move if move.ndim else move * self._tools[name].towards
            places.append(np.zeros(3) if name in stage.leave else places[-1] + along)

    def _gone(self, name):
        """How far a tool has gone towards the blank at the joints [mm]."""
        return np.array(self._places[name]) @ self._tools[name].towards

    def path(self, name: str, start: np.ndarray) -> Callable[[float], np.ndarray]:
        """Function of the load factor to where the tool's origin is, (3,) [mm]; start (3,)."""
        places = np.array(self._places[name]) + start
        return lambda load: np.array([np.interp(load, self.joints, axis) for axis in places.T])

    def force(self, name: str, share: float) -> Callable[[float], np.ndarray] | None:
        """Function of the load factor to the force (3,) [N] of a tool on this share of the blank,
        None if it has none."""
        if not (whole := self._forces.get(name)):
            return None
        return lambda load: share * np.interp(load, self.joints, whole) * self._tools[name].towards

    def pressure(self, name: str) -> Callable[[float], float] | None:
        """Function of the load factor to a holder's pressure [MPa], if stages change it."""
        values = self._pressures.get(name, [0.0])
        return (
            (lambda load: float(np.interp(load, self.joints, values))) if np.ptp(values) else None
        )

    def closes_straight(self, name: str, die: str) -> bool:
        """Whether a tool moves only along z and by no force, and its die does not move."""
        sideways = np.any(np.array(self._places[name])[:, :2])
        return not (self.is_moved(die) or name in self._forces or sideways)

    def distance(self, name: str, load: float) -> float:
        """Distance of a tool from its die at a load factor, where both are flat [mm]."""
        return self._reach[name] - float(np.interp(load, self.joints, self._gone(name)))

    def is_moved(self, name: str) -> bool:
        """Whether any stage moves the tool, or a force does."""
        return name in self._forces or bool(np.ptp(self._places[name], axis=0).any())

    def first_move(self, name: str) -> np.ndarray:
        """Displacement of the tool in the first stage that moves it (3,) [mm]."""
        steps = np.diff(self._places[name], axis=0)
        return steps[steps.any(1).argmax()]

    def leaders(self) -> list[str]:
        """For each stage the tool whose force and travel the curve shows: the one that moves
        furthest, else the one whose force changes most, or "" if none does."""
        leaders = [""] * len(self.stages)
        for series in (self._forces, self._places):
            for k, changes in enumerate(self._changes(series)):
                if changes.any():
                    leaders[k] = [*series][changes.argmax()]
        return leaders

    def _changes(self, series):
        """By how much each stage changes the forces or places of each tool (stages, tools)."""
        steps = [
            np.diff(values, axis=0).reshape(len(self.stages), -1) for values in series.values()
        ]
        sizes = [np.linalg.norm(each, axis=1) for each in steps]
        return np.reshape(sizes, (len(sizes), len(self.stages))).T

    def stage_at(self, load: float) -> int:
        """Number of the stage at a load factor, counted from 0."""
        return int(np.clip(np.searchsorted(self.joints, load) - 1, 0, len(self.stages) - 1))

    def travel(self, load: float) -> float:
        """Travel of the leading tools in all stages up to a load factor [mm]."""
        gone = np.append(0.0, self._changes(self._places).max(1).cumsum())
        return float(np.interp(load, self.joints, gone))
