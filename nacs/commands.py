"""Campaigns, cross-checks and replays: what the command does, from Python, with its results at hand."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import typer

from nacs.arguments import check_workers, path, real, several, table, text, whole, whole_if_given
from nacs.errors import extra, in_one_line
from nacs.nacs_error import NacsError
from sim.cli.commands.campaign import campaign as campaign_command
from sim.cli.commands.crosscheck import crosscheck as crosscheck_command
from sim.cli.commands.replay import replay as replay_command
from sim.cli.terminal import FAILED, INTERRUPTED, err, out, output_folder
from sim.text.toml_text import written

if TYPE_CHECKING:
    import pandas

CHECK_FAILED = 1
Place = str | os.PathLike[str]


@dataclass(frozen=True)
class Results:
    """What a command left in a folder.

    Attributes:
      folder: where its files are.
      text: what it printed.
      passed: of a cross-check, whether every check passed; True of the others.
    """

    folder: Path
    text: str
    passed: bool = True

    @property
    def summary(self) -> dict[str, Any]:
        """Content of `summary.json`."""
        with in_one_line():
            found: dict[str, Any] = json.loads((self.folder / "summary.json").read_text(encoding="utf-8"))
            return found

    @property
    def arrow(self) -> pa.Table:
        """Rows of the summary as an Arrow table."""
        return pa.Table.from_pylist(self.summary["rows"])

    @property
    def metrics(self) -> pandas.DataFrame:
        """The same as a DataFrame; needs the extra `data`."""
        with extra("pandas", "data"):
            frame: pandas.DataFrame = self.arrow.to_pandas()
            return frame

    def table(self, file: str) -> pa.Table:
        """A Parquet file of the folder, such as `trials.parquet` or `estimates.parquet`."""
        with in_one_line():
            if not str(file).endswith(".parquet") or not (self.folder / file).is_file():
                there = ", ".join(sorted(path.name for path in self.folder.glob("*.parquet")))
                raise NacsError(f"{file}: there is none in {self.folder}; there are {there or 'no tables'}")
            return pq.read_table(self.folder / file)

    def __str__(self) -> str:
        return self.text


def campaign(
    file: Place,
    *,
    out: Place | None = None,
    workers: int = 2,
    trials: int | None = None,
    seed: int | None = None,
    resume: bool = False,
) -> Results:
    """Fly a campaign, as `nacs campaign` does.

    >>> done = nacs.campaign("nacs-wheel-failure", trials=4, out="campaign")
    >>> done.table("trials.parquet").num_rows > 0
    True

    Args:
      file: campaign file, or the name of one that comes with the twin.
      out: folder for the results; default: a new one under `runs`.
      workers: processes; no number depends on it.
      trials: number of trials; default: the file's.
      seed: root seed; default: the file's.
      resume: do only what is missing in `out`.

    Raises:
      NacsError: one line; what was finished is kept, and the line says how to go on.
    """
    if resume and out is None:
        raise NacsError("resume=True needs out: the folder of the campaign to go on with")
    name, workers = text("file", file), whole("workers", workers, 1)
    trials, seed = whole_if_given("trials", trials, 1), whole_if_given("seed", seed)
    check_workers(workers, ())
    folder = _folder(out, f"campaigns/{Path(name).stem}", resume)
    return _done(campaign_command, folder, file=name, folder=folder, workers=workers, trials=trials, seed=seed, resume=resume)


def crosscheck(
    scenario: Place = "nacs/fault-free",
    *,
    out: Place | None = None,
    model: str | None = None,
    loop: str | None = None,
    at: Sequence[float] | None = None,
    thresholds: Mapping[str, float] | None = None,
    trials: int = 4,
    seed: int | None = None,
    set: Mapping[str, Any] | None = None,  # as the command calls it
) -> Results:
    """Cross-check an analytic model with the plant, as `nacs crosscheck` does; `passed` says whether every check passed.

    Args:
      scenario: name, or path of a TOML file.
      out: folder for the results; default: a new one under `runs`.
      model: variant of the model, or FILE.py; default: of the plant's kind.
      loop: whose control flies it; default: the first.
      at: instants of attribution, s.
      thresholds: by quantity.
      trials: over which shares are averaged.
      seed: root seed; default: the scenario's.
      set: dotted keys to values, taken instead of what the scenario says.

    Raises:
      NacsError: bad input, or a flight failed.
    """
    name = text("scenario", scenario)
    folder = _folder(out, f"crosscheck/{Path(name).stem if name.endswith('.toml') else name}", False)
    limits = [f"{quantity}={real(f'thresholds[{quantity!r}]', value)!r}" for quantity, value in table("thresholds", thresholds).items()]
    return _done(
        crosscheck_command,
        folder,
        name=name,
        folder=folder,
        model=model,
        loop=loop,
        at=None if at is None else [real("at", second) for second in several("at", at, "seconds")] or None,
        limits=limits,
        trials=whole("trials", trials, 1),
        seed=whole_if_given("seed", seed),
        overrides=_overrides(set),
    )


def replay(
    log: Place,
    *,
    out: Place | None = None,
    filters: Sequence[str] = (),
    observers: Sequence[Any] = (),
    tuning: str | None = None,
    set: Mapping[str, Any] | None = None,  # as the command calls it
    trust: bool = False,
) -> Results:
    """Run filters over a flight log, as `nacs replay` does; `table("estimates.parquet")` has what they estimate.

    Args:
      log: readings and commands, as docs/replay.md says.
      out: folder for the results; default: a new one under `runs`.
      filters: by name; default: all of the log's scenario.
      observers: filters of your own: classes, objects, or FILE.py:CLASS.
      tuning: of all filters, `paper` or `consistent`; default: as the log says.
      set: dotted keys to values, taken instead of what the log's scenario says.
      trust: go on with a log in which units, order or signs look wrong.

    Raises:
      NacsError: bad input, or a filter broke down.
    """
    file = path("log", log)
    folder = _folder(out, f"replay/{file.stem}", False)
    return _done(
        replay_command,
        folder,
        log=file,
        folder=folder,
        filters=[text("filters", one) for one in several("filters", filters, "names")],
        observers=[*several("observers", observers, "classes, objects or FILE.py:CLASS")],
        tuning=tuning,
        overrides=_overrides(set),
        trust=trust,
    )


def _folder(out: Place | None, name: str, resume: bool) -> Path:
    with in_one_line():
        if resume and out is not None:
            return path("out", out)
        return output_folder(None if out is None else path("out", out), name, False, "name another folder")


def _overrides(changes: Mapping[str, Any] | None) -> list[str]:
    with in_one_line():
        return [
            f"{key}={written(value.tolist() if isinstance(value, np.ndarray) else value)}" for key, value in table("set", changes).items()
        ]


def _done(command: Callable[..., None], target: Path, **arguments: Any) -> Results:
    """Call a command, keep what it prints, and turn how it leaves into a result or an exception."""
    code = 0
    with in_one_line(), out.capture() as printed, err.capture() as told:
        try:
            command(**arguments)
        except typer.Exit as left:
            code = left.exit_code
    lines = [line for line in told.get().splitlines() if line.startswith(("error: ", "interrupted"))]
    if code == INTERRUPTED:
        raise KeyboardInterrupt(*lines[-1:])
    if code not in (0, CHECK_FAILED):
        raise NacsError(lines[-1].removeprefix("error: ") if lines else "failed", code or FAILED)
    return Results(target, printed.get(), code == 0)
