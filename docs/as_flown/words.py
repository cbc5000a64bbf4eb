"""The posterior in tables of Markdown and in a file that a machine reads."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from docs.as_flown.causes import ALL, CAUSES, Cause, acting
from docs.as_flown.emulator import COMPARED, TRIALS, Emulator, Prediction, left_out_errors, printed, without
from docs.as_flown.flights import FILTERS
from docs.as_flown.posterior import WRONG, Posterior, log_likelihood, predicted_sums, predicted_values

Array = NDArray[np.floating]
Fits = Mapping[tuple[int, ...], Posterior]

FITTED = without(3)  # tables 1 to 3, which give the scenarios' numbers
PRIOR = 1.0 / np.sqrt(12.0)  # standard deviation of a share beforehand
TOLD = 0.75  # a table tells of a cause if by itself it makes the share's deviation this much smaller
KEYS = {
    "gyro noise": ("sensors.gyro_noise_rad_s", 1e-3),
    "attitude noise": ("sensors.attitude_noise_rad", 1e-3),
    "jitter of readings": ("sensors.jitter_s", 1e-3),
    "torque of the air": ("plant.air_torque_nm", 1e-3),
    "its correlation time": ("plant.air_torque_correlation_s", 1.0),
    "dry friction of the wheels": ("plant.wheel_coulomb_nm", 1e-3),
}


def told_by(fits: Fits, place: int) -> list[int]:
    """Numbers, from 1, of the tables that by themselves tell of a cause."""
    return [table + 1 for table in ALL if place in acting(table) and fits[(table,)].shares[:, place].std() < TOLD * PRIOR]


def moments(cause: Cause, shares: Array) -> tuple[float, float, float, float]:
    """Value at the mean share, standard deviation of the value, and the interval with 95 % of the samples."""
    values = cause.of_share(shares)
    low, high = np.quantile(values, [0.025, 0.975])
    return float(cause.of_share(shares.mean())), float(values.std()), float(low), float(high)


def likeliest(shares: Array, residuals: Array) -> Array:
    """Of candidates (points, causes) the one whose flights (tables, points, trials, filters, states) of tables 1 to 3 are nearest to print.

    The likelihood is that of the posterior, with flights in the place of the emulator and a deviation of a tenth, common and of each.
    """
    flown = np.log(residuals.mean(axis=2))[..., COMPARED]
    scatter = np.log(residuals).var(axis=2, ddof=1)[..., COMPARED] * (1.0 / residuals.shape[2] + 1.0 / TRIALS)
    wrong = np.full((len(shares), 2), WRONG)
    total = sum(log_likelihood(printed()[table][:, COMPARED], Prediction(flown[i], scatter[i]), wrong) for i, table in enumerate(FITTED))
    return shares[int(np.argmax(total))]


def listed(fits: Fits, flown: Array) -> str:
    """The list of parameters as TOML, with the covariance of their places in the ranges."""
    chosen = fits[FITTED]
    lines = [
        "# What McCafferty-Leroux et al. (2024), tables 1 to 3, say of their testbed. Printed by `python -m docs.as_flown infer`;",
        "# docs/as-flown.md says how. `value` is at the mean, `interval` holds 95 %; `told_by`: the tables that tell of it by themselves.",
        "# `scenarios` is what nacs/as-flown fly: of the likeliest samples the one whose flights of tables 1 to 3 are nearest to print.",
        "# A place in the range is log(value / low) / log(high / low), or linear where `logarithmic` is false; `covariance` is theirs.",
        "fitted_to_tables = [1, 2, 3]",
        "",
    ]
    for place, cause in enumerate(CAUSES):
        value, deviation, low, high = moments(cause, chosen.shares[:, place])
        lines += ["[[parameters]]", f'name = "{cause.name}"', f'unit = "{cause.unit}"']
        if cause.name in KEYS:
            key, unit = KEYS[cause.name]
            lines += [f'key = "{key}"', f"key_value = {unit * value:.4g}", f"key_standard_deviation = {unit * deviation:.2g}"]
        lines += [
            f"value = {value:.4g}",
            f"scenarios = {cause.of_share(flown[place]):.2g}",
            f"standard_deviation = {deviation:.2g}",
            f"interval = [{low:.3g}, {high:.3g}]",
            f"range = [{cause.low:g}, {cause.high:g}]",
            f"logarithmic = {str(cause.log).lower()}",
            f"deviation_over_prior = {chosen.shares[:, place].std() / PRIOR:.2f}",
            f"told_by = {told_by(fits, place)}",
            "",
        ]
    covariance = np.cov(chosen.shares.T)
    lines += ["[covariance]", "places = ["]
    lines += ["  [" + ", ".join(f"{number:.5f}" for number in row) + "]," for row in covariance]
    return "\n".join([*lines, "]", ""])


def tables(emulators: Mapping[int, Emulator], fits: Fits) -> str:
    """All tables of the page."""
    parts = (_emulators(emulators), _parameters(fits), _directions(fits[FITTED]), _by_table(fits), _predicted(emulators, fits))
    return "\n\n".join("\n".join(part) for part in parts)


def _emulators(emulators: Mapping[int, Emulator]) -> Iterator[str]:
    yield "| table | points used | q1 to q3: EKF, SIF, windowed, fading, % | rates, % | sums, % |"
    yield "|---|---|---|---|---|"
    for table, emulator in emulators.items():
        values, sums = left_out_errors(emulator)
        yield (
            f"| {table + 1} | {int(emulator.used.sum())} of {len(emulator.used)} "
            f"| {_percent(values[:, 0])} | {_percent(values[:, 1])} | {_percent(sums)} |"
        )


def _short(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.0f}" if value >= 1000.0 else f"{value:.3g}"


def _percent(values: Array) -> str:
    return " ".join(f"{100.0 * value:.1f}" for value in values)


def _parameters(fits: Fits) -> Iterator[str]:
    yield (
        "| parameter | unit | range before | tables 1 to 3: value, deviation, 95 % | deviation over prior "
        "| all four: value, deviation | told by table |"
    )
    yield "|---|---|---|---|---|---|---|"
    for place, cause in enumerate(CAUSES):
        value, deviation, low, high = moments(cause, fits[FITTED].shares[:, place])
        every = moments(cause, fits[ALL].shares[:, place])
        ratio = fits[FITTED].shares[:, place].std() / PRIOR
        told = ", ".join(str(table) for table in told_by(fits, place)) or "none"
        yield (
            f"| {cause.name} | {cause.unit} | {cause.low:g} to {cause.high:g} "
            f"| {_short(value)} +- {_short(deviation)}, {_short(low)} to {_short(high)} "
            f"| {ratio:.2f} | {_short(every[0])} +- {_short(every[1])} | {told} |"
        )
    for fit in (fits[FITTED], fits[ALL]):
        mean = fit.wrong.mean(axis=0)
        yield f"what the plant cannot do, tables {[t + 1 for t in fit.tables]}: common {mean[0]:.3f}, each {mean[1]:.3f}"


def _directions(fit: Posterior) -> Iterator[str]:
    sizes, vectors = np.linalg.eigh(np.cov(fit.shares.T))
    yield "| deviation over prior | direction in places of the ranges |"
    yield "|---|---|"
    for size, vector in zip(sizes, vectors.T, strict=True):
        large = np.argsort(-np.abs(vector))[:4]
        sign = np.sign(vector[large[0]])
        words = ", ".join(f"{sign * vector[i]:+.2f} {CAUSES[i].name}" for i in large if abs(vector[i]) > 0.25)
        yield f"| {np.sqrt(size) / PRIOR:.2f} | {words} |"


def _by_table(fits: Fits) -> Iterator[str]:
    yield "| parameter | table 1 alone | table 2 alone | table 3 alone | table 4 alone |"
    yield "|---|---|---|---|---|"
    for place, cause in enumerate(CAUSES[:11]):
        cells = [moments(cause, fits[(table,)].shares[:, place]) for table in ALL]
        yield (
            f"| {cause.name}, {cause.unit} | "
            + " | ".join(f"{_short(cell[0])} ({_short(cell[2])} to {_short(cell[3])})" for cell in cells)
            + " |"
        )


def _predicted(emulators: Mapping[int, Emulator], fits: Fits) -> Iterator[str]:
    yield "| table left out | | " + " | ".join(FILTERS) + " | values within their 95 % |"
    yield "|---|---|---|---|---|---|---|"
    for table in ALL:
        for name, fit in (("predicted", fits[without(table)]), ("fitted too", fits[ALL])):
            low, middle, high = 1e3 * np.quantile(predicted_sums(emulators[table], fit), [0.025, 0.5, 0.975], axis=0)
            ends = np.quantile(predicted_values(emulators[table], fit), [0.025, 0.975], axis=0)
            inside = np.sum((printed()[table][:, COMPARED] > ends[0]) & (printed()[table][:, COMPARED] < ends[1]))
            cells = " | ".join(f"{m:.2f} ({a:.2f} to {b:.2f})" for a, m, b in zip(low, middle, high, strict=True))
            yield f"| {table + 1} | {name} | {cells} | {inside} of 24 |"
        yield f"| {table + 1} | printed | " + " | ".join(f"{1e3 * value:.2f}" for value in printed()[table].sum(axis=-1)) + " | |"
