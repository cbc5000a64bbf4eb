"""FMUs are built: a scenario of one body becomes a file that other simulators load."""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from sim.bad_input import BadInput
from sim.fmu.co_simulated_plant import SCENARIO_FILE
from sim.loop.open_loop import single_body
from sim.scenario import files
from sim.scenario.files import AnyScenario


class Standard(NamedTuple):
    """A version of the Functional Mock-up Interface."""

    package: str  # that builds FMUs of it
    slave: str  # file beside this one
    options: tuple[str, ...]  # what such an FMU can do


STANDARDS = MappingProxyType(
    {
        "3": Standard("pythonfmu3", "nacs_plant_fmi3.py", ("canGetAndSetFMUState", "canSerializeFMUState")),
        "2": Standard("pythonfmu", "nacs_plant_fmi2.py", ("canGetAndSetFMUstate", "canSerializeFMUstate")),
    }
)


def check(scenario: AnyScenario, version: str) -> None:
    """Raise BadInput if a scenario cannot be an FMU of this version, or not here."""
    if version not in STANDARDS:
        raise BadInput(f"--fmi {version}: there is no such version; there are {', '.join(STANDARDS)}")
    single_body(scenario)
    if find_spec(STANDARDS[version].package) is None:
        raise BadInput(f"--fmi {version} needs {STANDARDS[version].package}: pip install 'nacs-twin[fmi]'")


def write(path: Path, scenario: AnyScenario, version: str) -> None:
    """Write the plant and sensors of a scenario as an FMU for co-simulation."""
    standard = STANDARDS[version]
    able = dict.fromkeys((*standard.options, "canHandleVariableCommunicationStepSize", "needsExecutionTool"), True)
    before = list(sys.path)
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder) / SCENARIO_FILE
        said.write_text(json.dumps(files.dumped(scenario)), encoding="utf-8")
        try:
            built = _builder(version).build_FMU(Path(__file__).with_name(standard.slave), dest=folder, project_files=[said], **able)
        finally:
            sys.path[:] = before  # the builder leaves folders there
        shutil.copyfile(built, path)


def _builder(version: str) -> Any:
    """The package's class that packs an FMU."""
    if version == "2":
        from pythonfmu import FmuBuilder
    else:
        from pythonfmu3 import FmuBuilder
    return FmuBuilder
