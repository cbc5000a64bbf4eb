"""The register of formats that signals can be given away in."""

from __future__ import annotations

from types import MappingProxyType

from sim.export import comma_separated, foxglove, matlab, netcdf

FORMATS = MappingProxyType({module.FORMAT.key: module.FORMAT for module in (comma_separated, matlab, netcdf, foxglove)})
