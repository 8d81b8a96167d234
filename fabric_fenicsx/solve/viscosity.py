"""Viscous regularisation of steps that smaller steps do not mend."""

from dataclasses import dataclass


@dataclass
class Viscosity:
    """Drag on every node [N/mm per step], relative to the mean `stiffness` of one [N/mm], and the
    energy that it took [N mm]. It is weakened after `easy_steps_asked` uncut steps in a row, a
    number that each failure doubles."""

    drag: float = 0.0
    energy: float = 0.0
    stiffness: float = 0.0
    easy_steps: int = 0
    easy_steps_asked: int = 1
    WEAK, STRONG = 1e-7, 1e-1  # drags, of the mean stiffness of a node

    def strengthen(self) -> bool:
        """Go one stage up; False if the drag is as strong as allowed."""
        if self.drag >= self.STRONG * self.stiffness:
            return False
        if self.drag:
            self.easy_steps_asked = min(2 * self.easy_steps_asked, 16)
        self.drag, self.easy_steps = max(self.WEAK * self.stiffness, 10 * self.drag), 0
        return True

    def note_accepted(self, uncut: bool, at_rest: bool) -> None:
        """Count an accepted step, and weaken the drag if it is due; at rest it always is."""
        if not self.drag:
            return
        self.easy_steps = self.easy_steps + 1 if uncut else 0
        if at_rest or self.easy_steps >= self.easy_steps_asked:
            self.drag = self.drag / 4 if self.drag > self.WEAK * self.stiffness else 0.0
            self.easy_steps = 0
