"""Short flights of every scenario of one tree, put down as arrays and text; `python -m tests.regression` runs it in each tree.

It is run by path with PYTHONPATH naming the tree, so that it knows nothing but what `nacs run` of that tree would do. A tree with other
rooms needs one more function like `separate_loops` and one more line in LAYOUTS, with channels and metrics under the same names.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
import tomllib
import traceback
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]
MetricRow = tuple[str, str, str, str, AnyArray]  # subject, metric, phase, unit, one value a trial

TRIALS = 2
FLOORS = ("models", "estimation", "control", "sim")
TIMES = ("start_s", "end_s", "duration_s")  # of a fault, in proportion to the run; what else has a duration (a delay) stays as it is
SINES_PERIOD = 600.0  # what an [identification] that does not say its period has, in 1 / lambda
LEAST_SINES_PERIOD = 5.0  # a shorter one has no sine for one of the two channels
ALL_LOOPS = "(all loops)"  # where a metric is put that does not say of which of several loops it is


class Flight(NamedTuple):
    """What a scenario left.

    Attributes:
      channels: of every closed loop, by name.
      metrics: of all loops.
      occurrences: of every closed loop, a line each.
    """

    channels: dict[str, dict[str, AnyArray]]
    metrics: list[MetricRow]
    occurrences: dict[str, list[str]]


def scenario_files(tree: Path) -> dict[str, Path]:
    """Files of all scenarios of a tree by family/name, wherever below sim/ they lie."""
    folder = next((path.parent.parent for path in (tree / "sim").rglob("nacs/disturbance.toml")), None)
    return {} if folder is None else {f"{path.parent.name}/{path.stem}": path for path in sorted(folder.glob("*/*.toml"))}


def shorten(data: dict[str, Any], ticks: int) -> dict[str, Any]:
    """The same scenario, cut down to so many ticks and to TRIALS trials, with all that happens at a time moved into the run in proportion.

    The published numbers stay: they are only shown. A window is put on whole ticks and has at least one, since there is no mean over none.
    """
    run = data["run"]
    short, tick = min(run["ticks"], ticks), run["tick_s"]
    share = short / run["ticks"]
    out = data | {"run": run | {"ticks": short, "trials": TRIALS}}
    if "faults" in data:
        out["faults"] = [{key: _scaled(value, share) if key in TIMES else value for key, value in f.items()} for f in data["faults"]]
    if "phases" in data:
        out["phases"] = {name: _window(span, share, short, tick) for name, span in data["phases"].items()}
    if "identification" in data:  # three more flights under sines, each as long as three of their periods
        sines = data["identification"]
        out["identification"] = sines | {"period": max(LEAST_SINES_PERIOD, share * sines.get("period", SINES_PERIOD))}
    return out


def _scaled(value: Any, share: float) -> Any:
    """A number, or all numbers of a draw."""
    if isinstance(value, dict):
        return {kind: _scaled(part, share) for kind, part in value.items()}
    return [_scaled(part, share) for part in value] if isinstance(value, list) else share * value


def _window(span: list[float], share: float, ticks: int, tick_s: float) -> list[float]:
    """Start and end of a window in a shorter run, s."""
    start = min(round(share * span[0] / tick_s), ticks - 1)
    return [start * tick_s, max(start + 1, round(share * span[1] / tick_s)) * tick_s]


def separate_loops(data: dict[str, Any], label: str) -> Flight:
    """One body, formation and consensus each with a loop of its own: sim.shards and the families, as `nacs run` calls them."""
    families, shards = import_module("sim.families"), import_module("sim.shards")
    scenario, trials = families.check(data, label, {}), np.arange(TRIALS)
    family = families.of(scenario)
    if family is None:
        shard = shards.simulate(scenario, trials, trials)
        if shard.failure:
            raise RuntimeError(shard.failure)
        metrics, flown = shard.metrics, shard.recordings
    else:
        metrics, flown = family.simulate(scenario, trials, trials, None)
    channels = {loop: _arrays(left) for loop, left in flown.items()}
    occurrences = {loop: [_line(o._asdict()) for o in getattr(left, "occurrences", ())] for loop, left in flown.items()}
    return Flight(channels, [tuple(metric) for metric in metrics], occurrences)


def one_loop(data: dict[str, Any], label: str) -> Flight:
    """One loop for every body: sim.campaign.blocks, as `nacs run` calls it; names as the separate loops had them."""
    files, blocks = import_module("sim.scenario.files"), import_module("sim.campaign.blocks")
    scenario, trials = files.check(data, label, {}), np.arange(TRIALS)
    block = blocks.simulate(scenario, trials, trials)
    if block.failure:
        raise RuntimeError(block.failure)
    channels = {loop: _arrays(left) for loop, left in block.recordings.items()}
    occurrences = {loop: [_line(o._asdict()) for o in left.occurrences] for loop, left in block.recordings.items()}
    if scenario.family != "body":
        names = FORMATION if scenario.family == "formation" else CONSENSUS
        channels = {loop: {names.get(name, name): array for name, array in of.items()} for loop, of in channels.items()}
        first = {loop: [_line(o._asdict()) for o in left.occurrences if o.trial == 0] for loop, left in block.recordings.items()}
        occurrences = {loop: [line.removeprefix("trial 0: ") for line in lines] for loop, lines in first.items()}
    return Flight(channels, [tuple(metric) for metric in block.metrics], occurrences)


# channels by what they were called where every kind of scenario had a loop of its own
FORMATION = {
    "truth/state": "state",
    "truth/q_BN": "q_BN",
    "truth/wheel_speed": "wheel_speed",
    "truth/qpos": "qpos",
    "control/acceleration": "acceleration",
    "messages/received": "received",
    "reference/leader": "constant/leader",
}
CONSENSUS = {"truth/state": "truth", "reference/leader": "constant/leader", "reference/leader_rate": "constant/leader_rate"}


def _arrays(left: Any) -> dict[str, AnyArray]:
    """All that a Recording of one body, or a Flown of several, holds; what it has beside its channels under names of their own."""
    out = dict(left.channels)
    for part, prefix in (("findings", "finding"), ("figures", "figure")):
        out |= {f"{prefix}/{name}": array for name, array in getattr(left, part, {}).items()}
    limits = getattr(left, "thresholds", {})
    out |= {f"threshold/{name}": np.array(pair) for name, pair in limits.items() if pair is not None}
    constant = ("leader", "leader_rate", "places", "ways", "weights")
    return out | {f"constant/{name}": getattr(left, name) for name in constant if hasattr(left, name)}


def _line(event: dict[str, Any]) -> str:
    trial = f"trial {event['trial']}: " if "trial" in event else ""
    return f"{trial}ticks {event['start_tick']} to {event['end_tick']}, {event['kind']}: {event['text']}"


# a module that only trees of that layout have, and how those trees are flown; the first that is found counts, the newest being on top
LAYOUTS: tuple[tuple[str, Callable[[dict[str, Any], str], Flight]], ...] = (
    ("sim.loop.closed_loop", one_loop),
    ("sim.shards", separate_loops),
)


def layout() -> Callable[[dict[str, Any], str], Flight]:
    """How this tree is flown."""
    for mark, fly in LAYOUTS:
        try:
            if find_spec(mark) is not None:
                return fly
        except ModuleNotFoundError:  # a room of that name does not exist, or is a module
            continue
    raise RuntimeError(f"no layout that is known: none of {', '.join(mark for mark, _ in LAYOUTS)} is there")


def loop_of(row: MetricRow, loops: list[str]) -> str:
    """Which loop a metric is of: the only one, the one that its subject begins with, or the one that is its phase."""
    if len(loops) == 1:
        return loops[0]
    return next((name for name in (row[0], row[0].split("/")[0], row[2]) if name in loops), ALL_LOOPS)


def put_down(flight: Flight, file: Path) -> dict[str, Any]:
    """Write all arrays into `file`; by loop, names with hash and key in there, metrics as hexadecimal floats, occurrences."""
    loops = list(flight.channels)
    said: dict[str, Any] = {name: {"channels": {}, "metrics": {}, "occurrences": flight.occurrences.get(name, [])} for name in loops}
    arrays: dict[str, AnyArray] = {}
    for loop in loops:
        for name, array in flight.channels[loop].items():
            key = f"a{len(arrays)}"
            arrays[key] = np.ascontiguousarray(array).reshape(np.shape(array))
            said[loop]["channels"][name] = {"key": key, "hash": _hash(arrays[key])}
    for row in flight.metrics:
        subject, metric, phase, unit, values = row
        of = said.setdefault(loop_of(row, loops), {"channels": {}, "metrics": {}, "occurrences": []})["metrics"]
        name, again = f"{subject} {metric}@{phase} [{unit}]", 2
        while name in of:
            name, again = f"{subject} {metric}@{phase} [{unit}] #{again}", again + 1
        of[name] = [float(value).hex() for value in values]
    np.savez(file, **arrays)
    return said


def _hash(array: AnyArray) -> str:
    """Of type, shape and bytes."""
    return hashlib.sha256(f"{array.dtype.str} {array.shape} ".encode() + array.tobytes()).hexdigest()


def strangers(tree: Path) -> list[str]:
    """Modules of the house that did not come from the tree."""
    own = {name: module for name, module in sys.modules.items() if name.split(".")[0] in FLOORS and getattr(module, "__file__", None)}
    return [name for name, module in own.items() if not Path(str(module.__file__)).resolve().is_relative_to(tree)]


def main() -> None:
    """Fly the named scenarios of a tree and leave `flown.json` and an .npz file of each in a folder."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("tree", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("side", help="what the tree is called in the lines that tell how far it is")
    parser.add_argument("ticks", type=json.loads, help="JSON: ticks of every scenario to be flown, by name")
    asked = parser.parse_args()
    tree = asked.tree.resolve()
    files, out = scenario_files(tree), {}
    for number, (name, ticks) in enumerate(asked.ticks.items()):
        started, file = time.perf_counter(), asked.folder / f"{number}.npz"
        try:
            data = shorten(tomllib.loads(files[name].read_text(encoding="utf-8")), ticks)
            out[name] = {"arrays": file.name, "loops": put_down(layout()(data, f"{name}.toml"), file)}
        except Exception as reason:  # whatever it is, the other scenarios are flown
            where = traceback.extract_tb(reason.__traceback__)[-1]
            out[name] = {"error": f"{type(reason).__name__}: {reason} ({Path(where.filename).name}:{where.lineno})"}
        print(f"{asked.side} {name}: {time.perf_counter() - started:.1f} s", flush=True)
    if others := strangers(tree):
        raise SystemExit(f"modules that are not of {tree}: {', '.join(others)}")
    (asked.folder / "flown.json").write_text(json.dumps(out), encoding="utf-8")


if __name__ == "__main__":
    main()
