"""Curves of a run with several loops or agents in an open Rerun viewer while it happens: errors of every estimate, and the motion."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from models.dynamics.state_layout import StateLayout
from sim.loop.recorder import Recorder
from sim.rerun.live import VIEWER, connect
from sim.rerun.sink import APPLICATION, describe, entity, time_column
from sim.series.estimation_errors import error_of_block, unit_of_error

Array = NDArray[np.floating]


class LiveCurves:
    """Shows the first trial of every loop while it runs, one loop after the other, each in a tab of its own."""

    def __init__(
        self, scenario_name: str, loops: tuple[str, ...], layout: StateLayout, configuration: dict[str, Any], url: str = VIEWER
    ) -> None:
        """Connect and lay the viewer out.

        Raises:
          ConnectionError: no viewer listens at `url`.
        """
        self._layout = layout
        self._styled: set[str] = set()
        self._stream = rr.RecordingStream(APPLICATION)
        connect(self._stream, url, self._page(loops))
        describe(self._stream, scenario_name, configuration)

    def on_tick(self, loop: str, tick: int, recorder: Recorder) -> None:
        """Send what is so at `tick` of a loop."""
        time = [time_column(np.array([tick * recorder.dt]))]
        for path, names, values in self._curves(tick, recorder):
            place = entity(f"{loop}/{path}")
            if place not in self._styled:
                self._styled.add(place)
                self._stream.log(place, rr.SeriesLines(names=list(names)), static=True)
            self._stream.send_columns(place, time, rr.Scalars.columns(scalars=values[None]))

    def close(self) -> None:
        """Send what is still under way and disconnect."""
        self._stream.disconnect()

    def _curves(self, tick: int, recorder: Recorder) -> Iterator[tuple[str, tuple[str, ...], Array]]:
        here = slice(tick, tick + 1)
        truth = recorder.array("truth/state")[here, 0]
        means = {
            name: recorder.array(f"{index}:mean")[here, member, 0]
            for index, estimator in enumerate(recorder.estimators)
            for member, name in enumerate(estimator.names)
        }
        agents = truth[0].reshape(-1, truth.shape[-1])
        for block in self._layout.blocks:
            place = self._layout.places[block.kind]
            if truth.shape[-1] < place.stop:
                continue
            names = tuple(f"{i + 1} {name}" if len(agents) > 1 else name for i, _ in enumerate(agents) for name in block.names)
            yield f"truth/{block.kind}", names, agents[:, place].ravel()
            if means:
                wrong = np.array([error_of_block(mean, truth, block, place)[0] for mean in means.values()])
                yield f"errors/{block.kind}", tuple(f"{name} [{unit_of_error(block)}]" for name in means), wrong

    def _page(self, loops: tuple[str, ...]) -> rrb.Blueprint:
        tabs = []
        for loop in loops:
            views = [
                rrb.TimeSeriesView(origin=entity(f"{loop}/{what}/{block.kind}"), name=f"{title}: {block.kind}")
                for block in self._layout.blocks
                for what, title in (("errors", "Errors of estimates"), ("truth", f"Truth [{block.unit}]"))
            ]
            tabs.append(rrb.Grid(*views, grid_columns=2, name=loop))
        return rrb.Blueprint(
            rrb.Tabs(*tabs, active_tab=0),
            rrb.TimePanel(state="collapsed", play_state="following"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.BlueprintPanel(state="collapsed"),
            auto_layout=False,
            auto_views=False,
        )
