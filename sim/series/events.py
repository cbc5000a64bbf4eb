"""What happens in several closed loops: faults, what each observer believes of them, and the log of both, whatever shows it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.series.loops import Flight
from sim.text.table_style import counted


def state_timelines(several: tuple[Flight, ...]) -> dict[str, list[tuple[int, str]]]:
    """Changes (tick, state) of the fault, and of what the observer of each loop believes of it."""
    longest = max(flight.recording.ticks for flight in several)
    faults = np.full(longest, "none", dtype=object)
    for start, end, text in sorted({(o.start_tick, o.end_tick, o.text) for f in several for o in f.recording.occurrences}):
        faults[start:end] = [text if now == "none" else f"{now}, {text}" for now in faults[start:end]]
    found = {"fault": changes(faults)}
    for flight in several:
        if (modes := flight.probabilities) is not None:
            found[flight.name] = changes(np.array(flight.modes, dtype=object)[np.argmax(modes, axis=-1)])
        elif flight.closing and flight.recording.thresholds[flight.closing]:
            declared = flight.channel(f"{flight.closing}/declared").astype(bool)
            found[flight.name] = changes(np.where(declared, "faulty", "healthy").astype(object))
    return found


def changes(states: NDArray[np.object_]) -> list[tuple[int, str]]:
    """Ticks at which a state differs from the one before, and what it is then."""
    return [(int(k), str(states[k])) for k in np.flatnonzero(np.append(True, states[1:] != states[:-1]))]


def events(several: tuple[Flight, ...], scenario_name: str) -> list[tuple[int, str, str]]:
    """What happened, as (tick, level, text), in order."""
    first, told = several[0], state_timelines(several)
    last, dt = max(flight.recording.ticks for flight in several), first.recording.dt
    happened = {o[1:] for flight in several for o in flight.recording.occurrences if o.start_tick < last}
    spared = [flight.name for flight in several if not flight.recording.occurrences]
    but = f" (not in {', '.join(spared)})" if spared else ""
    found = [(0, "INFO", f"start of {scenario_name}, trial {first.recording.trials[0]}: {counted(len(several), 'loop')}")]
    found += [(start, "ERROR", f"fault begins: {text}{but}") for start, _, _, text in happened]
    found += [(end, "INFO", f"fault ends: {text}") for _, end, _, text in happened if end < last]
    starts = sorted(start for start, *_ in happened)
    for flight in several:
        for k, state in told.get(flight.name, [])[1:]:
            begun = [start for start in starts if start <= k] if flight.recording.occurrences else []
            cause = f"{dt * (k - begun[-1]):.1f} s into the last" if begun else "none has begun"
            found.append((k, "INFO" if state == "healthy" else "WARN", f"{flight.name} believes: {state} ({cause})"))
    return [*sorted(found, key=lambda e: e[0]), (last - 1, "INFO", "end of the recording")]
