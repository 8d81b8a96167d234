"""Of the rows of a test those that load the fabric: from 0 or the end of its slack on, up to the
first turn."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import nnls

from ...readers.text_tables import some
from ...runtime.formatting import percent, rounded
from .model import Table, units

NOISE = 0.01  # of its range, by which a column may go back or begin below 0
_NEAR = 0.99  # share of the largest strain from which a branch counts as loaded in full
_LEAST = 0.01  # of its range, up to which slack is not worth a word
_SURE = 15.0  # by how much the logarithm of likelihood is to be better with slack than with crimp
_POWERS, _LENGTHS = np.arange(1, 7), np.array([0.1, 0.2, 0.4])  # of toes of crimp
_NEAR_IT = np.array([2, 3])  # of what looks slack: rows in which a kink is sought
_ROUNDED = 1e-4  # of the peak, to which forces are known at best


def kept(table: Table, which: np.ndarray) -> Table:
    """The rows of a table by numbers or flags `which`."""
    columns = {name: values[which] for name, values in table.columns.items()}
    return table._replace(columns=columns, rows=np.array(table.rows)[which].tolist())


def _in_file(table, column, value):
    """A value of a column in the unit of its file."""
    unit = table.header[column]
    return f"{rounded(value / units(column).get(unit, 1.0), 4)} {unit}".removesuffix(" -")


def from_zero(table: Table, column: str, sign: int) -> tuple[Table, list[str]]:
    """The table without rows in which a column of this sign lies by `NOISE` on the other side of 0,
    and a sentence on them."""
    values = sign * table.columns[column]
    below = (values < 0) & (values >= -NOISE * values.max(initial=0.0))
    if not below.any():
        return table, []
    least = _in_file(table, column, sign * values[below].min())
    rows = some([f"row {row}" for row in np.array(table.rows)[below]])
    return kept(table, ~below), [f"{rows} left out, as {column} is {least} there, beyond 0"]


def loading_branch(table: Table, column: str) -> tuple[Table, list[str]]:
    """The rows up to the first turn of the column, and sentences on those behind it and on those in
    which it goes back by no more than `NOISE`. A table whose first branch ends before its largest
    values is given back whole."""
    size = np.abs(table.columns[column] - table.columns[column][0]) if table.rows else np.zeros(0)
    if not size.any():
        return table, []
    top = np.maximum.accumulate(size)
    stop = int(np.argmax(np.append(top - size > NOISE * size.max(), True)))
    if top[stop - 1] < _NEAR * size.max():
        return table, []
    end, told = int(size[:stop].argmax()), []
    if end + 1 < len(size):
        told.append(
            f"{column} turns back behind row {table.rows[end]}: of the loop the loading branch is "
            f"fitted, rows {table.rows[0]} to {table.rows[end]}"
        )
        table = kept(table, np.arange(end + 1))
    if (still := np.flatnonzero(np.diff(size[: end + 1]) <= 0) + 1).size:
        rows, back = some([f"row {table.rows[k]}" for k in still]), (top - size)[: end + 1].max()
        far = f" and goes back by up to {_in_file(table, column, back)}" if back else ""
        told.append(f"{column} does not move on in {rows}{far}; read as scatter")
    return table, told


def way_back(table: Table, column: str, turn: int) -> Table:
    """The rows of a table from the row `turn` of its file on, down to the next turn of the
    column."""
    table = kept(table, np.flatnonzero(np.array(table.rows) >= turn))
    x = table.columns[column]
    up = x - np.minimum.accumulate(x) > NOISE * np.ptp(x)
    stop = int(np.argmax(np.append(up, True)))
    return kept(table, np.arange(x[:stop].argmin() + 1))


def slack(table: Table, column: str, measured: str) -> tuple[float, list[str]]:
    """Where a rising column ends that the measured one does not follow at first, and a sentence on
    it; 0 if there is no slack.

    Slack ends in a kink. So a parabola that begins where it ends must follow the rows near there
    better than crimp does: powers of the strain and curves that get straight, which rise from 0 on.
    """
    order = np.argsort(table.columns[column], kind="stable")
    x, y = table.columns[column][order], table.columns[measured][order]
    if len(x) < 8 or y.max() <= 0:
        return 0.0, []
    y = y / y.max()
    scatter = np.median(np.abs(np.diff(y, 4))) / 5.64  # of normal noise
    high = sliding_window_view(y > max(10 * _ROUNDED, 3 * scatter), 3).all(1)
    low = int(high.argmax())  # rows before the first three that noise does not explain
    if low < 3 or x[low - 1] < _LEAST * x[-1]:
        return 0.0, []
    sure, end = max(_kink(x[:n], y[:n]) for n in np.searchsorted(x, x[low - 1] * _NEAR_IT, "right"))
    if sure < _SURE or end < _LEAST * x[-1]:
        return 0.0, []
    shown, rows = _in_file(table, column, end), np.array(table.rows)[order][x <= end]
    most = percent(y[: len(rows)].max(), 2)
    return end, [
        f"rows {rows[0]} to {rows[-1]}: {measured} is up to {most} of its peak and then begins to "
        f"rise at {column} {shown}: this slack is taken off; a line `# slack: 0 "
        f"{table.header[column]}` keeps it"
    ]


def _kink(x, y):
    """By how much the logarithm of likelihood of rows (n,) is better with slack than with crimp,
    and where the slack ends."""
    s, found = x / x[-1], []
    for end in np.linspace(s[2], s[-4], 200):
        loaded = np.maximum(s - end, 0.0)[:, None] ** (1, 2)
        off = loaded @ np.linalg.lstsq(loaded, y, rcond=None)[0] - y
        found.append((off @ off, end))
    straightened = s[:, None] + _LENGTHS * np.expm1(-s[:, None] / _LENGTHS)
    crimp = nnls(np.hstack([s[:, None] ** _POWERS, straightened]), y)[1] ** 2
    least, end = min(found)
    known = len(x) * _ROUNDED**2
    return len(x) * np.log((crimp + known) / (least + known)), float(end * x[-1])
