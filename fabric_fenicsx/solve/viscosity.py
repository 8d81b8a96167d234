"""Viscous regularisation of steps that smaller steps do not mend."""

from dataclasses import dataclass

WEAK, STRONG = 1e-7, 1e-1  # drag on a node, of the mean stiffness of one


@dataclass
class Viscosity:
    """A drag on every node [N/mm per step], measured by the mean `stiffness` of one [N/mm]; energy
    taken by it [N mm]. It fades by one stage after `easy_steps_asked` steps in a row that passed
    uncut, a number that each failure doubles."""

    drag: float = 0.0
    energy: float = 0.0
    stiffness: float = 0.0
    easy_steps: int = 0
    easy_steps_asked: int = 1

    def strengthen(self) -> bool:
        """One stage more; False if it is as strong as allowed."""
        if self.drag >= STRONG * self.stiffness:
            return False
        if self.drag:
            self.easy_steps_asked = min(2 * self.easy_steps_asked, 16)
        self.drag, self.easy_steps = max(WEAK * self.stiffness, 10 * self.drag), 0
        return True

    def note_accepted(self, uncut: bool, at_rest: bool) -> None:
        """Note a step that passed. At rest, as the load does not change, the drag fades after each;
        otherwise after `easy_steps_asked` that passed uncut."""
        if not self.drag:
            return
        self.easy_steps = self.easy_steps + 1 if uncut else 0
        if at_rest or self.easy_steps >= self.easy_steps_asked:
            self.drag = self.drag / 4 if self.drag > WEAK * self.stiffness else 0.0
            self.easy_steps = 0
