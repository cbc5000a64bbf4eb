"""`detection.png`: what each detector saw and declared; which scenarios have one; and that words do not leave a picture."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from sim.series import raster

QUICK = ("--trials", 1, "--set", "run.ticks=60", "--without", "recording", "--without", "report", "--out", "it")
PUSHED = ("--set", "faults=[{kind='external-torque',torque_nm=0.02,direction=[1.0,0.0,0.0],start_s=2.0,duration_s=1.0}]")


def curves(axes) -> dict[str, np.ndarray]:
    return {line.get_label(): np.asarray(line.get_ydata(), dtype=float) for line in axes.lines}


def test_each_detector_has_its_statistic_its_thresholds_and_what_it_declared(nacs, tmp_path, figures) -> None:
    """The windowed sum of the last 45 raw values is the smooth curve, and the state is 1 while it is above the thresholds of eq. 22."""
    result = nacs("run", "nacs/disturbance", *QUICK, *PUSHED, "--also", "detection")
    assert result.code == 0, result.err
    assert {path.name for path in (tmp_path / "it").iterdir()} >= {"detection.png"}
    reference, *blocks = figures[0].axes
    assert [axes.get_title(loc="left") for axes in blocks[::2]] == ["nis-windowed", "nis-fading"]
    desired = np.stack([curves(reference)[f"$q_{i}$"] for i in range(1, 5)])
    np.testing.assert_allclose(np.sum(desired**2, axis=0), 1.0)
    np.testing.assert_allclose(desired[:, 0], [0, 0, 0, 1], atol=1e-12)  # the phase is that of the start
    seen, state = curves(blocks[0]), next(iter(curves(blocks[1]).values()))
    on, off = (next(v[0] for k, v in seen.items() if k.startswith(what)) for what in ("on", "off"))
    assert (on, off) == pytest.approx((598.0, 547.9), abs=0.05)  # chi-square of 495 degrees of freedom, tails 0.001 and 0.05
    raw, smooth = seen["NIS"], seen["smoothed NIS"]
    np.testing.assert_allclose(smooth[50], raw[6:51].sum(), rtol=1e-9)
    assert state.max() == 1.0
    assert (smooth[state > 0] > off).all()
    assert (smooth[state == 0] <= on).all()


def test_a_filter_with_modes_shows_its_probability(nacs, figures) -> None:
    imm = 'observers.imm={type="imm",filter={type="ekf"},modes=[[],[{kind="float",wheel=1}]]}'
    assert nacs("run", "nacs/fault-free", *QUICK, "--set", imm, "--also", "detection").code == 0
    pages = {axes.get_title(loc="left"): curves(axes) for axes in figures[0].axes[1::2]}
    assert set(pages) == {"nis-windowed", "nis-fading", "imm"}
    assert "NIS" not in pages["imm"]
    assert pages["imm"]["probability of a fault"].max() <= 1.0


@pytest.mark.parametrize(
    ("scenario", "said"),
    [("formation/fault-free", "is of several agents"), ("monolithic/fault-free", "no observer of this scenario declares faults")],
)
def test_what_has_no_detector_is_told_before_anything_flies(nacs, tmp_path, scenario: str, said: str) -> None:
    result = nacs("run", scenario, "--also", "detection", "--out", "it")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "--also detection: " in result.err
    assert said in result.err
    assert not list(tmp_path.iterdir())


def test_words_end_within_the_picture() -> None:
    """As laid out they would be wider than the picture; what is left ends in dots, and a short line is left alone."""
    figure = Figure(figsize=(5, 2), dpi=80)
    long = figure.text(0.01, 0.9, "wheel 1 without power at 20 s; " * 12, fontsize=8)
    short = figure.text(0.01, 0.5, "nothing fails", fontsize=8)
    title = figure.suptitle("a title that somebody has written with more words than there is room for in it\n", x=0.01, ha="left")
    with mpl.rc_context({}):
        picture = raster.pixels(figure)
    assert (picture[:, -1, :3] == 255).all()
    assert long.get_text().startswith("wheel 1 without power at 20 s; wheel 1")
    assert long.get_text().endswith(" ...")
    assert title.get_text().endswith(" ...\n")
    assert short.get_text() == "nothing fails"
