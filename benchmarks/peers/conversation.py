"""Both ends of a conversation with a peer: arrays go to a process of its own and arrays come back, round by round."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import venv
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[np.floating]]

ROOT = Path(__file__).parents[2]
ENVIRONMENTS = Path(__file__).parents[1] / ".peers"


class PeerMissing(RuntimeError):
    """A peer that cannot be had or does not start here; says why in a line."""


class Peer:
    """A peer that waits for work: a module of this package, run in an environment where `package` is installed."""

    def __init__(self, package: str, module: str) -> None:
        self._folder = tempfile.TemporaryDirectory()
        command = [str(environment(package)), "-m", f"benchmarks.peers.{module}", package]
        self._process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self._line()["version"]

    def ask(self, work: str, **arrays: NDArray[np.floating] | float) -> Arrays:
        """Have `work` done on the arrays; `seconds` of the answer is the time that the peer counted for it."""
        question, answer = (Path(self._folder.name) / name for name in ("question.npz", "answer.npz"))
        np.savez(question, allow_pickle=False, **arrays)
        assert self._process.stdin
        print(json.dumps({"work": work, "question": str(question), "answer": str(answer)}), file=self._process.stdin, flush=True)
        self._line()
        with np.load(answer) as file:
            return dict(file)

    def _line(self) -> dict[str, str]:
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            raise PeerMissing(f"its process ended with code {self._process.wait()}")
        return json.loads(line)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait()
        self._folder.cleanup()


def environment(package: str) -> Path:
    """The Python of a virtual environment that holds `package`, made at the first call."""
    folder = ENVIRONMENTS / package
    python, ready = folder / "bin" / "python", folder / "ready"
    if not ready.exists():
        print(f"installing {package} into {folder.relative_to(ROOT)} ...", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        try:
            subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", package], check=True)
        except subprocess.CalledProcessError as failed:
            raise PeerMissing(f"pip could not install {package} for Python {sys.version_info.major}.{sys.version_info.minor}") from failed
        ready.touch()
    return python


def answer(works: dict[str, Callable[[Arrays], Arrays]]) -> None:
    """The peer's end: do what is asked until there is nothing more. What the peer prints goes to standard error."""
    with os.fdopen(os.dup(1), "w") as out:
        os.dup2(2, 1)
        print(json.dumps({"version": version(sys.argv[1])}), file=out, flush=True)
        for line in sys.stdin:
            asked = json.loads(line)
            with np.load(asked["question"]) as file:
                done = works[asked["work"]](dict(file))
            np.savez(asked["answer"], allow_pickle=False, **done)
            print("{}", file=out, flush=True)
