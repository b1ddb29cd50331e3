"""Where the code of a module can be broken, and how: one small change each, in the bodies of its functions."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

KINDS = ("operator", "sign", "comparison", "constant", "off by one")
OPERATORS = {"Add": ("+", "-"), "Sub": ("-", "+"), "Mult": ("*", "/"), "Div": ("/", "*")}
REVERSED = {
    "Lt": ("<", ">"),
    "Gt": (">", "<"),
    "LtE": ("<=", ">="),
    "GtE": (">=", "<="),
    "Eq": ("==", "!="),
    "NotEq": ("!=", "=="),
}


@dataclass(frozen=True)
class Site:
    """One change: characters `start` to `end` of a file become `text`; its line before and after, for people."""

    file: str
    line: int
    kind: str
    start: int
    end: int
    text: str
    original: str
    mutant: str

    def mutated(self, source: str) -> str:
        """The source with the change."""
        return source[: self.start] + self.text + source[self.end :]


def sites_of(file: str, source: str) -> list[Site]:
    """All changes of a module, in the order of its text; file: what it is called."""
    module = _Module(file, source)
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    found = {site for function in functions for statement in function.body for site in module.sites(statement)}
    return sorted(found, key=lambda site: (site.start, site.end, site.kind))


class _Module:
    def __init__(self, file: str, source: str) -> None:
        self.file, self.source, self.lines = file, source, source.splitlines(keepends=True)
        self.starts = [0]
        for line in self.lines:
            self.starts.append(self.starts[-1] + len(line))

    def sites(self, node: ast.AST) -> Iterator[Site]:
        """Changes of a statement and of all in it; messages of errors, annotations and docstrings stay."""
        if isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef):
            return
        yield from self._of(node)
        for name, value in ast.iter_fields(node):
            if name != "annotation":
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        yield from self.sites(child)

    def _of(self, node: ast.AST) -> Iterator[Site]:
        match node:
            case ast.BinOp(op=op) if type(op).__name__ in OPERATORS:
                yield from self._between("operator", node.left, node.right, *OPERATORS[type(op).__name__])
            case ast.AugAssign(op=op) if type(op).__name__ in OPERATORS:
                yield from self._between("operator", node.target, node.value, *OPERATORS[type(op).__name__])
            case ast.UnaryOp(op=ast.USub()):
                start = self._place(node)
                yield self._site("sign", start, start + 1, "")
            case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op).__name__ in REVERSED:
                yield from self._between("comparison", left, right, *REVERSED[type(op).__name__])
            case ast.Constant(value=float(value)):
                yield self._site("constant", self._place(node), self._end(node), repr(2.0 * value if value else 1.0))
            case ast.Constant(value=int(value)) if not isinstance(value, bool):
                yield self._site("off by one", self._place(node), self._end(node), repr(value + 1))
            case ast.Call(func=ast.Name(id="range"), args=[*_, stop]) if not isinstance(
                stop, ast.Constant | ast.UnaryOp
            ):
                yield self._site("off by one", self._end(stop), self._end(stop), " - 1")

    def _between(self, kind: str, left: ast.AST, right: ast.AST, old: str, new: str) -> Iterator[Site]:
        """A change of the operator between two operands, which may stand in parentheses."""
        low, high = self._end(left), self._place(right)
        if found := re.search(rf"(?<=[\s)]){re.escape(old)}(?=[\s(=])", self.source[low:high]):
            yield self._site(kind, low + found.start(), low + found.end(), new)

    def _site(self, kind: str, start: int, end: int, text: str) -> Site:
        row = self.source.count("\n", 0, start)
        begin = self.starts[row]
        line = self.lines[row]
        mutant = line[: start - begin] + text + line[end - begin :]
        return Site(self.file, row + 1, kind, start, end, text, line.strip(), mutant.strip())

    def _place(self, node: ast.AST) -> int:
        return self._character(node.lineno, node.col_offset)

    def _end(self, node: ast.AST) -> int:
        return self._character(node.end_lineno, node.end_col_offset)

    def _character(self, line: int, bytes_before: int) -> int:
        """Place in the source of a place in bytes of a line, as trees have it."""
        return self.starts[line - 1] + len(self.lines[line - 1].encode()[:bytes_before].decode())
