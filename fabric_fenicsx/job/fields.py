"""The fields of a job."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..results.curve import Curves, Measure
from ..results.result import Result
from ..runtime.rules import POSITIVE
from ..scene.scene import Scene
from ..solve.settings import Settings


@dataclass(frozen=True, kw_only=True)
class JobFields(Settings):
    """Fields of a `Job`, which explains them."""

    scene: Scene = field(kw_only=False)
    error: bool = False
    coarser: Callable[[], Any] | None = None
    order: float = 1.0
    headlines: Sequence[str] = ()
    measure: Measure | None = None
    stage: Callable[[float], str] | None = None
    columns: Callable[[Scene], dict[str, float]] | None = None
    force_name: str = "reaction"
    modelled: float = 1.0
    quantities: Callable[[Result], dict[str, Any]] | None = None
    tables: Callable[[Result, Path], None] | None = None
    pictures: Callable[[Result, Path], None] | None = None
    first_picture: Callable[[Path], None] | None = None
    warnings: Iterable[str] = ()
    beside: Curves = field(default_factory=dict)
    name: str = "job"

    def __post_init__(self) -> None:
        super().__post_init__()
        POSITIVE.check("`order`", self.order)
