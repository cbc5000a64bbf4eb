"""Colours that mean the same thing in every picture: one for each wheel, one for each observer."""

from __future__ import annotations

WHEEL_COLORS = ("#eb4236", "#33b859", "#3b82f5", "#fabf2e")

OBSERVER_COLORS = {
    "ekf": "#e07a1f",
    "mekf": "#8a8f98",
    "sif": "#7b4fb5",
    "nis-windowed": "#1f9e89",
    "nis-fading": "#1b4f9c",
}
