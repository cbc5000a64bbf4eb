"""Small wrong changes of a Python source, as a tired person makes them: operator, sign, edge, axis, transpose, name, default, ...

Nothing is changed in annotations, decorators, messages of errors, and text. Every change leaves the rest of the file as it is.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple


class Mutant(NamedTuple):
    """One change: `old`, which stands at bytes `start` to `stop` of the file at `place`, becomes `new`."""

    place: str
    kind: str
    line: int
    start: int
    stop: int
    old: str
    new: str
    lines: tuple[int, int]  # first and last of the statement around it
    names: tuple[str, ...]  # what the statement binds, if it is executed when the module is imported

    def __str__(self) -> str:
        return f"{self.place}:{self.line} {self.kind}: {' '.join(self.old.split())} -> {' '.join(self.new.split())}"

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.new.encode() + source[self.stop :]


Change = tuple[ast.AST, ast.AST | str]  # what goes, what comes
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mod,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
NEGATED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
EDGES: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
PAIRS = ("min max", "minimum maximum", "nanmin nanmax", "argmin argmax", "any all", "sin cos", "floor ceil", "zeros ones", "mean sum")
OTHERS = {one: other for pair in PAIRS for one, other in (pair.split(), pair.split()[::-1])}
# calls without which a value is of the same kind
CONVERSIONS = {
    *("abs", "sqrt", "square", "exp", "log", "clip", "normalize", "align", "degrees", "radians", "round", "floor", "nan_to_num"),
    *("cumsum", "sort", "wrapped", "symmetrize"),
}
UNTOLD = {"strict", "dtype", "frozen", "eq", "slots", "copy", "check", "description", "title", "encoding"}  # keywords left alone
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)


def _called(node: ast.AST) -> str:
    """The last name of a called function."""
    func = node.func if isinstance(node, ast.Call) else None
    return func.attr if isinstance(func, ast.Attribute) else func.id if isinstance(func, ast.Name) else ""


def _is_text(node: ast.AST) -> bool:
    literal = isinstance(node, ast.JoinedStr | ast.List | ast.Tuple) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
    return literal or (isinstance(node, ast.Name) and node.id[:1].isupper() and not node.id.isupper())  # or a type


def _operands(node: ast.AST) -> tuple[ast.expr, ast.expr] | None:
    """Both sides of arithmetic on numbers or arrays."""
    return (node.left, node.right) if isinstance(node, ast.BinOp) and not (_is_text(node.left) or _is_text(node.right)) else None


def _number(node: ast.AST, kind: type) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) is kind


def operator(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in OPERATORS:
        other = OPERATORS[type(node.op)]()
        if isinstance(node, ast.AugAssign):
            yield node, ast.AugAssign(node.target, other, node.value)
        elif sides := _operands(node):
            yield node, ast.BinOp(sides[0], other, sides[1])


def operands_swapped(node: ast.AST) -> Iterator[Change]:
    if (sides := _operands(node)) and isinstance(node, ast.BinOp) and isinstance(node.op, ast.Sub | ast.Div | ast.MatMult | ast.Pow):
        yield node, ast.BinOp(sides[1], node.op, sides[0])


def term_dropped(node: ast.AST) -> Iterator[Change]:
    if (sides := _operands(node)) and isinstance(node, ast.BinOp):
        yield node, sides[0]
        if isinstance(node.op, ast.Add | ast.Mult | ast.MatMult):
            yield node, sides[1]
    elif isinstance(node, ast.BoolOp):
        for one in node.values:
            rest = [value for value in node.values if value is not one]
            yield node, rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)


def comparison(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield node, ast.Compare(node.left, [NEGATED[type(node.ops[0])]()], node.comparators)


def edge(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Compare):
        for i, op in enumerate(node.ops):
            if type(op) in EDGES:
                yield node, ast.Compare(node.left, [*node.ops[:i], EDGES[type(op)](), *node.ops[i + 1 :]], node.comparators)


def and_or(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.BoolOp):
        yield node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)


def ten_percent(node: ast.AST) -> Iterator[Change]:
    if _number(node, float) and node.value:
        yield node, f"{1.1 * node.value:.6g}"


def off_by_one(node: ast.AST) -> Iterator[Change]:
    if _number(node, int):
        yield node, str(node.value + 1)
        if node.value > 0:
            yield node, str(node.value - 1)


def flag_flipped(node: ast.AST) -> Iterator[Change]:
    if _number(node, bool):
        yield node, str(not node.value)


def sign(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield node, node.operand
    elif isinstance(node, ast.Return | ast.Assign) and (
        _operands(node.value) or _called(node.value) in {"einsum", "where", "sum", "cross"}
    ):
        yield node.value, ast.UnaryOp(ast.USub(), node.value)


def not_dropped(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
        yield node, node.operand


def transpose(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Attribute) and node.attr in {"T", "mT"}:
        yield node, node.value
    elif isinstance(node, ast.Call) and _called(node) in {"swapaxes", "transpose", "moveaxis"} and len(node.args) == 3:
        yield node, node.args[0]
    elif isinstance(node, ast.Call) and _called(node) == "einsum" and isinstance(node.args[0], ast.Constant):
        *taken, given = str(node.args[0].value).split("->")
        if len(given) > 1 and given[-2:].isalpha():
            yield node.args[0], repr("->".join([*taken, given[:-2] + given[-1] + given[-2]]))


def other_function(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Call) and _called(node) in OTHERS:
        other = OTHERS[_called(node)]
        func = ast.Attribute(node.func.value, other) if isinstance(node.func, ast.Attribute) else ast.Name(other)
        yield node.func, ast.unparse(func)


def arguments_swapped(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Call) and len(node.args) > 1 and _called(node) not in {"isinstance", "getattr", "issubclass", "zip"}:
        one, two, *rest = node.args
        if not any(isinstance(arg, ast.Starred) for arg in (one, two)) and not _is_text(one):
            yield node, ast.Call(node.func, [two, one, *rest], node.keywords)


def keyword_dropped(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Call):
        for keyword in node.keywords:
            if keyword.arg and keyword.arg not in UNTOLD:
                yield node, ast.Call(node.func, node.args, [k for k in node.keywords if k is not keyword])


def axis(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.keyword) and node.arg == "axis":
        text = ast.unparse(node.value)
        if other := {"-1": "-2", "-2": "-1", "0": "1", "1": "0", "2": "1"}.get(text):
            yield node.value, other


def default(node: ast.AST) -> Iterator[Change]:
    found: list[ast.expr | None] = []
    if isinstance(node, FUNCTION):
        found = [*node.args.defaults, *node.args.kw_defaults]
    elif isinstance(node, ast.AnnAssign):
        given = (
            node.value.args[0] if isinstance(node.value, ast.Call) and _called(node.value) == "Field" and node.value.args else node.value
        )
        found = [given]
    for value in found:
        if value is not None:
            yield from (change for kind in (ten_percent, off_by_one, flag_flipped) for change in kind(value))


def branch(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.If | ast.While):
        yield node.test, "False"
    if isinstance(node, ast.If):
        yield node.test, "True"
    elif isinstance(node, ast.IfExp):
        yield node, ast.IfExp(node.test, node.orelse, node.body)
    elif isinstance(node, ast.Call) and _called(node) == "where" and len(node.args) == 3:
        yield node, ast.Call(node.func, [node.args[0], node.args[2], node.args[1]], node.keywords)


def returned_swapped(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple) and len(node.value.elts) > 1:
        one, two, *rest = node.value.elts
        yield node.value, ast.Tuple([two, one, *rest], ast.Load())


def conversion_dropped(node: ast.AST) -> Iterator[Change]:
    if isinstance(node, ast.Call) and _called(node) in CONVERSIONS and node.args:
        yield node, node.args[0]


def statement_dropped(node: ast.AST) -> Iterator[Change]:
    stored = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript | ast.Attribute)
    if stored or isinstance(node, ast.AugAssign) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)):
        yield node, "pass"


def returned_early(node: ast.AST) -> Iterator[Change]:
    """A list of statements ends before what follows, where nothing is returned at its end."""
    if isinstance(node, ast.FunctionDef) and not any(isinstance(one, ast.Return | ast.Yield | ast.YieldFrom) for one in ast.walk(node)):
        yield from ((after, "return") for _, after in pairwise(node.body) if ast.unparse(after) != "...")


def other_argument(node: ast.AST) -> Iterator[Change]:
    """One argument of a function is read in place of another that is declared alike."""
    if isinstance(node, ast.FunctionDef):
        typed = [(a.arg, ast.unparse(a.annotation)) for a in (*node.args.args, *node.args.kwonlyargs) if a.annotation]
        following = {one: two for (one, kind), (two, other) in pairwise(typed) if kind == other}
        for name in (inner for statement in node.body for inner in ast.walk(statement)):
            if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Load) and name.id in following:
                yield name, following[name.id]


KINDS: dict[str, Callable[[ast.AST], Iterator[Change]]] = {
    kind.__name__.replace("_", " "): kind
    for kind in (
        *(operator, operands_swapped, term_dropped, comparison, edge, and_or, ten_percent, off_by_one, flag_flipped, sign, not_dropped),
        *(transpose, other_function, arguments_swapped, keyword_dropped, axis, default, branch, returned_swapped, conversion_dropped),
        *(statement_dropped, returned_early, other_argument),
    )
}
OF_A_BODY = {"returned early", "other argument"}  # found at a function, but changes of what is inside
SKIPPED = (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.Assert)
SKIPPED_FIELDS = {"annotation", "returns", "decorator_list", "bases", "type_params"}


def _nodes(node: ast.AST, around: ast.AST, names: tuple[str, ...]) -> Iterator[tuple[ast.AST, ast.AST, tuple[str, ...]]]:
    """Every node with the statement around it and what that binds at import; () inside functions."""
    if isinstance(node, ast.stmt):
        around = node
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names = (node.name,)
        elif names and isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = tuple(n.id for target in targets for n in ast.walk(target) if isinstance(n, ast.Name)) or names
    yield node, around, names
    for name, value in ast.iter_fields(node):
        inside = () if name == "body" and isinstance(node, FUNCTION) else names
        for child in value if isinstance(value, list) else [value]:
            untold = isinstance(child, SKIPPED) or (isinstance(child, ast.keyword) and child.arg in UNTOLD)
            if isinstance(child, ast.AST) and name not in SKIPPED_FIELDS and not untold:
                yield from _nodes(child, around, inside)


def mutants(place: str, source: str) -> list[Mutant]:
    """All changes of a file that are known here; each is Python, none is the file itself."""
    tree = ast.parse(source)
    starts = [0, *(i + 1 for i, byte in enumerate(source.encode()) if byte == ord("\n"))]
    found: dict[tuple[int, int, str], Mutant] = {}
    for node, around, names in _nodes(tree, tree, ("",)):
        for kind, changes in KINDS.items():
            at_import = () if kind in OF_A_BODY else names
            for gone, come in changes(node):
                start, stop = starts[gone.lineno - 1] + gone.col_offset, starts[gone.end_lineno - 1] + gone.end_col_offset
                old, new = ast.unparse(gone), come if isinstance(come, str) else ast.unparse(come)
                more = "\n" * (gone.end_lineno - gone.lineno)  # so that what follows stays on its lines
                if isinstance(gone, ast.expr):
                    new = new if isinstance(come, str) and not more else f"({new}{more})"
                else:
                    new += more
                head = around.body[0].lineno - 1 if isinstance(getattr(around, "body", None), list) else around.end_lineno
                statement = (gone if isinstance(gone, ast.stmt) or kind == "other argument" else around).lineno
                lines = (statement, max(head, statement, gone.end_lineno))
                if new.strip("()") != old.strip("()"):
                    found.setdefault((start, stop, new), Mutant(place, kind, gone.lineno, start, stop, old, new, lines, at_import))
    return list(found.values())
