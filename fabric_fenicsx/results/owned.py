"""The files of a run: a list in its folder says which they are; all others there are a user's."""

from contextlib import suppress
from pathlib import Path

from ..core.files import read_json, write_json
from .report import CAPTIONS

LIST = ".files.json"
# of what runs write into their folder and those of their parts
NAMES = (
    *"summary.json history.csv checkpoint.npz log.txt report.html press.toml press_*.toml".split(),
    *"fields.pvd tools.pvd fields/[0-9]*.vt* tools/[0-9]*.vt* wrinkles*.vtu paths*.csv".split(),
    *f"axis.csv curves.csv parameters.csv variants.csv {LIST}".split(),
    *(f"{name}*.png" for name in CAPTIONS),
)


class OwnedFiles:
    """Files of a run in `folder` and in those of its `parts`, as its list has them. While it is
    under way, or after it was killed, and for a summary without a list, as earlier versions wrote
    it, these are all files that have one of the `NAMES`. inputs: files that a run reads, which it
    does not replace."""

    def __init__(self, folder: Path) -> None:
        known = read_json(folder / LIST)
        if not known and "fabric_fenicsx" in read_json(folder / "summary.json").get("versions", ()):
            known = {"parts": [""], "files": None}
        self.folder, self.inputs = folder, list[Path]()
        self.parts, self._listed = known.get("parts", []), known.get("files", [])

    def _present(self, *parts):
        """Files of parts that have one of the `NAMES`, whosever they are."""
        found = (f for part in parts for name in NAMES for f in (self.folder / part).glob(name))
        return {str(file.relative_to(self.folder)) for file in found if file.is_file()}

    def names(self, *endings: str) -> list[str]:
        """Files of the run, as seen from its folder, with these endings of their paths."""
        own = self._present(*self.parts)
        own &= own if self._listed is None else {*self._listed}
        return sorted(each for each in own if each.endswith(endings or ("",)))

    def others(self, part: str, resume: bool) -> list[str]:
        """What a run of this part would replace and is not its own: files, inputs, other runs."""
        own = set(self.names())
        found = self._present("", part) - own
        if not resume:
            runs = (f for name in (LIST, "summary.json") for f in self.folder.glob(f"*/{name}"))
            found |= {each.parent.name for each in runs} - {*self.parts, part}
            found |= {name for name in own if (self.folder / name).resolve() in self.inputs}
        return sorted(found)

    def note(self, *parts: str, is_over: bool = False) -> None:
        """Write the list, of all files once the run is over; parts: those that begin."""
        self.parts = [*dict.fromkeys([*self.parts, *parts])]
        self._listed = self.names() if is_over else None
        write_json(self.folder / LIST, {"parts": self.parts, "files": self._listed})

    def remove(self) -> None:
        """Remove the files of the run, and folders that are then empty."""
        files = [self.folder / name for name in self.names()]
        for file in files:
            file.unlink()
        for folder in sorted({file.parent for file in files} - {self.folder}, reverse=True):
            with suppress(OSError):  # not empty
                folder.rmdir()
        self.parts = []
