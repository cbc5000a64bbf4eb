"""Imported before anything else of the face: raises NacsError if a package that it would import is not the twin's."""

from __future__ import annotations

from nacs.nacs_error import NacsError
from nacs_twin.own_packages import what_is_foreign

if said := what_is_foreign():
    raise NacsError(said)
