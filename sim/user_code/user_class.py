"""A class of the user's, in a Python file or a notebook, and the blame for what goes wrong in it: one line that names file and line.

A file that is named is run as code, with all that code may do.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

from sim.bad_input import BadInput


class UserClass:
    """A class of the user's: named as FILE.py:CLASS, or handed in by Python."""

    def __init__(self, given: Any, option: str, methods: tuple[str, ...]) -> None:
        """Find the class.

        Args:
          given: FILE.py:CLASS, whose file is run as code; a class or a function, which is called with a `Setting`; or an object, of which
            each batch of trials gets a copy.
          option: what it was given for.
          methods: that it must have.
        """
        self._lines, self._is_told = {"": 1}, True
        if isinstance(given, str):
            self._load(given, option)
        else:
            self._take(given, option)
        with suppress(TypeError, ValueError):  # of what is not written in Python
            self._is_told = bool(inspect.signature(self._make).parameters)
        for method in methods if self.type is not None else ():
            found_method = getattr(self.type, method, None)
            if not callable(found_method):
                raise self.complaint("", f"has no method {method}")
            code = getattr(found_method, "__code__", None)
            if code and code.co_filename == self._path:
                self._lines[method] = code.co_firstlineno
        with self.blamed(""):
            said = getattr(given if not isinstance(given, str) else self.type, "name", None)
        parts = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"
        self.name: str = said if isinstance(said, str) and said else re.sub(parts, "-", self.title).lower().replace("_", "-")

    def _load(self, text: str, option: str) -> None:
        """Run the file and take the class."""
        self.file, _, self.title = text.rpartition(":")
        if not self.file or not self.title.isidentifier():
            raise BadInput(f"{option} {text}: needs the form FILE.py:CLASS")
        try:
            self._path = str(Path(self.file).resolve())
            source = Path(self._path).read_text(encoding="utf-8-sig")
        except (OSError, ValueError) as unreadable:
            raise BadInput(f"{option} {text}: {getattr(unreadable, 'strerror', None) or unreadable}") from None
        module = ModuleType(f"guest_{Path(self.file).stem}")
        module.__file__ = self._path
        sys.modules[module.__name__] = module  # where dataclasses look their module up
        folder = str(Path(self._path).parent)
        if folder not in sys.path:
            sys.path.append(folder)  # for what lies beside the file
        with self.blamed(""):
            exec(compile(source, self._path, "exec"), module.__dict__)
            found = {node.name: node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}
        self.type: Any = getattr(module, self.title, None)
        if not isinstance(self.type, type):
            raise BadInput(f"{option} {text}: no class {self.title} in {self.file}; there are {', '.join(found) or 'none'}")
        self._lines[""] = found[self.title].lineno if self.title in found else 1
        self._make: Callable[..., Any] = self.type

    def _take(self, given: Any, option: str) -> None:
        """Take a class, a function that makes its instances, or an instance that is copied."""
        makes = isinstance(given, type) or (callable(given) and not hasattr(given, "step"))
        named = given if makes else type(given)
        self.type = named if isinstance(named, type) else None  # what a function makes is not known before it is called
        self.title = str(getattr(named, "__name__", type(given).__name__))
        if not self.title.isidentifier():
            raise BadInput(f"{option} {self.title}: give a class, an object, or a function with a name that makes one")
        code = getattr(named, "__code__", None) or getattr(getattr(named, "step", None), "__code__", None)
        self.file = self._path = code.co_filename if code else f"<{self.title}>"
        self._lines[""] = code.co_firstlineno if code else 1
        self._make = given if makes else lambda *_: deepcopy(given)

    def construct(self, *arguments: Any) -> Any:
        """An instance, told of its setting if it takes an argument."""
        with self.blamed("__init__"):
            return self._make(*arguments) if self._is_told else self._make()

    def complaint(self, method: str, what: str) -> BadInput:
        """One line that names file, line and method."""
        return BadInput(f"{self.file}:{self._lines.get(method, self._lines[''])}: {self.title}{method and '.'}{method}: {what}")

    @contextmanager
    def blamed(self, method: str, when: str = "") -> Iterator[None]:
        """Turn any exception inside into a complaint at the line of the user's file that led to it."""
        try:
            yield
        except KeyboardInterrupt:
            raise
        except BaseException as wrong:  # also what a program seldom raises: an exit, a generator's end
            lines = [frame.lineno for frame in traceback.extract_tb(wrong.__traceback__) if frame.filename == self._path]
            if isinstance(wrong, SyntaxError) and wrong.filename == self._path:
                lines.append(wrong.lineno)
            said = words_of(wrong)
            line = lines[-1] if lines else self._lines.get(method, self._lines[""])
            what = f"{self.title}{method and '.'}{method}: {type(wrong).__name__}{': ' + said if said else ''}{when}"
            raise BadInput(f"{self.file}:{line}: {what}") from None


def words_of(wrong: BaseException) -> str:
    """What an exception says of itself, if it can, as one line of at most 300 characters."""
    try:
        return " ".join(str(wrong).split())[:300]
    except Exception:  # the user's own class may be unable to
        return ""
