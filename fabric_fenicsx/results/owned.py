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
    *"axis.csv curves.csv parameters.csv variants.csv".split(),
    *(f"{name}*.png" for name in CAPTIONS),
    LIST,
)


class OwnedFiles:
    """Files of a run in `folder` and in those of its `parts`, as its list has them. While it is
    under way, or after it was killed, and for a summary without a list, as earlier versions wrote
    it, these are all files that have one of the `NAMES`. inputs: files that a run reads, which it
    does not replace."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.inputs = folder, list[Path]()
        self.read()

    def read(self) -> None:
        """Read the list."""
        known = read_json(self.folder / LIST)
        if not known and "fabric_fenicsx" in read_json(self.folder / "summary.json").get(
            "versions", ()
        ):
            known = {"parts": [""], "files": None}
        self.parts, self._listed = known.get("parts", []), known.get("files", [])

    def _present(self, part):
        """Files of a part that have one of the `NAMES`, whosever they are."""
        found = (each for name in NAMES for each in (self.folder / part).glob(name))
        return {str(each.relative_to(self.folder)) for each in found if each.is_file()}

    def names(self, *endings: str) -> list[str]:
        """Files of the run, as seen from its folder, with these endings of their paths."""
        present = set[str]().union(*map(self._present, self.parts))
        own = present if self._listed is None else present.intersection(self._listed)
        return sorted(each for each in own if each.endswith(endings or ("",)))

    def others(self, part: str, resume: bool) -> list[str]:
        """Files that a run of this part would replace and that are not its own, or are inputs, and
        folders of other runs."""
        own = set(self.names())
        found = (self._present("") | self._present(part)) - own
        if resume:
            return sorted(found)
        runs = (each for name in (LIST, "summary.json") for each in self.folder.glob(f"*/{name}"))
        found |= {each.parent.name for each in runs} - {*self.parts, part}
        return sorted(
            found | {name for name in own if (self.folder / name).resolve() in self.inputs}
        )

    def begin(self, part: str) -> None:
        """Note that a part is under way."""
        self._listed, self.parts = None, [*dict.fromkeys([*self.parts, "", part])]
        write_json(self.folder / LIST, {"parts": self.parts, "files": None})

    def end(self) -> None:
        """List what the run has written."""
        self._listed = self.names()
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
