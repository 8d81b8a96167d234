"""Of the rows of a test those that load the fabric: from 0 on, up to the first turn."""

import numpy as np

from ...core.errors import InputError
from ...io.text_tables import some
from .model import Table, unit_inside

NOISE = 0.01  # of its range, by which a column may go back or begin below 0


def kept(table: Table, which: np.ndarray) -> Table:
    """The rows of a table by numbers or flags `which`."""
    columns = {name: values[which] for name, values in table.columns.items()}
    return table._replace(columns=columns, rows=np.array(table.rows)[which].tolist())


def from_zero(table: Table, column: str, sign: int) -> tuple[Table, list[str]]:
    """The table without rows of a column that is by `NOISE` beyond 0, and words on these."""
    values = sign * table.columns[column]
    below = (values < 0) & (values >= -NOISE * values.max(initial=0.0))
    if not below.any():
        return table, []
    rows = some([f"row {row}" for row in np.array(table.rows)[below]])
    return kept(table, ~below), [f"{rows} left out, as {column} is by noise beyond 0 there"]


def loading_branch(table: Table, column: str) -> tuple[Table, list[str]]:
    """The rows up to the first turn of the column, and sentences on those behind it and on those in
    which it goes back by no more than `NOISE`. InputError if that ends before its largest value."""
    x = table.columns[column]
    size = x - x[:1]
    if not size.any():
        return table, []
    size = size * np.sign(size[np.abs(size).argmax()])
    top = np.maximum.accumulate(size)
    stop = int(np.argmax(np.append(top - size > NOISE * size.max(), True)))
    if top[stop - 1] < 0.99 * size.max():
        turn = f"{x[stop]:.4g} {unit_inside(column)} after {x[stop - 1]:.4g}"
        allowed = "to rise or fall throughout (keep one loading branch)"
        raise InputError(f"row {table.rows[stop]}: {column} is {turn}; allowed is {allowed}")
    end, remarks = int(size[:stop].argmax()), []
    if end + 1 < len(size):
        loop = f"{column} turns back behind row {table.rows[end]}: of the loop the loading branch"
        remarks.append(f"{loop} is fitted, rows {table.rows[0]} to {table.rows[end]}")
        table = kept(table, np.arange(end + 1))
    if (still := np.flatnonzero(np.diff(size[: end + 1]) <= 0) + 1).size:
        rows = some([f"row {table.rows[k]}" for k in still])
        remarks.append(f"{column} does not move on in {rows}; read as scatter")
    return table, remarks


def way_back(table: Table, column: str, turn: int) -> Table:
    """The rows from the row `turn` of the file on, down to the next turn of the column."""
    table = kept(table, np.flatnonzero(np.array(table.rows) >= turn))
    x = table.columns[column]
    up = x - np.minimum.accumulate(x) > NOISE * np.ptp(x)
    stop = int(np.argmax(np.append(up, True)))
    return kept(table, np.arange(x[:stop].argmin() + 1))
