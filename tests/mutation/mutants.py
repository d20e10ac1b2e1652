"""Mutants of a module: its source with one small change each, made by the operators of mutmut.

mutmut's own runner ignores decorated functions, module-level tables and closures created on import, which include most
of the rights and of the SHACL compiler's limits; therefore only its operators are used.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import libcst as cst
from libcst import matchers
from libcst.metadata import CodeRange, MetadataWrapper, PositionProvider
from mutmut.mutation.file_mutation import MutationVisitor, OuterFunctionProvider
from mutmut.mutation.mutators import mutation_operators
from mutmut.mutation.pragma_handling import IgnoredCode

from mutation.modules import module_name

_CONTEXT = 32  # characters shown on each side of a change
_FOR_TYPE_CHECKERS = matchers.Assign(value=matchers.Call(func=matchers.Name("TypeVar")))
_FOR_STAR_IMPORTS = matchers.Assign(targets=[matchers.AssignTarget(matchers.Name("__all__"))])


@dataclass(frozen=True)
class Mutant:
    """The module ``name`` with ``source`` replacing the file ``path``; ``change``: its row in a table."""

    name: str
    path: Path
    source: str
    change: tuple[str, str, str]
    """Place (``module.function``), code before and code after."""


class _Visitor(MutationVisitor):
    def _skip_node_and_children(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef):
            return False  # decorated functions as well
        if matchers.matches(node, _FOR_TYPE_CHECKERS | _FOR_STAR_IMPORTS) or self._is_sentence(node):
            return True
        return super()._skip_node_and_children(node)

    def _is_sentence(self, node: cst.CSTNode) -> bool:
        """Return True for a string with a space in a function: tests need not check each word for people."""
        is_text = isinstance(node, cst.SimpleString) and " " in node.value.strip("\"' ")
        return is_text and self.get_metadata(OuterFunctionProvider, node, None) is not None


def mutants(root: Path, file: str) -> list[Mutant]:
    """Return all distinct mutants of ``file``, in the order of the file."""
    path = root / file
    source = path.read_text()
    name = module_name(file)
    tree = ast.parse(source)
    unchanged = ast.dump(tree)
    found: dict[str, Mutant] = {}
    for start, end, text in _replacements(source):
        mutated = source[:start] + text + source[end:]
        if mutated not in found and _parsed(mutated) not in (None, unchanged):
            place = f"{path.stem}.{_place(tree, source.count(chr(10), 0, start) + 1)}"
            found[mutated] = Mutant(name, path, mutated, (place, *_change(source, start, end, text)))
    return list(found.values())


def _parsed(source: str) -> str | None:
    try:
        return ast.dump(ast.parse(source))
    except SyntaxError:
        return None


def _replacements(source: str) -> Iterator[tuple[int, int, str]]:
    """Yield the offsets of the code that each mutation replaces, and the replacement."""
    wrapper = MetadataWrapper(cst.parse_module(source))
    visitor = _Visitor(mutation_operators, IgnoredCode(set(), set(), set()))
    wrapper.visit(visitor)
    positions = wrapper.resolve(PositionProvider)
    lines = [0]
    for line in source.splitlines(keepends=True):
        lines.append(lines[-1] + len(line))
    for mutation in visitor.mutations:
        where = positions[mutation.original_node]
        assert isinstance(where, CodeRange)
        start, end = (lines[at.line - 1] + at.column for at in (where.start, where.end))
        while source[start].isspace():  # operators own the space around them
            start += 1
        while source[end - 1].isspace():
            end -= 1
        yield start, end, wrapper.module.code_for_node(mutation.mutated_node).strip()


def _place(node: ast.AST, line: int) -> str:
    """Return the names of classes, functions or variables around a line, from the outside in."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt) and child.lineno <= line <= (child.end_lineno or child.lineno):
            inner = _place(child, line)
            return ".".join(filter(None, (_name(child), inner)))
    return ""


def _name(statement: ast.stmt) -> str:
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return statement.name
    target = statement.targets[0] if isinstance(statement, ast.Assign) else getattr(statement, "target", None)
    return target.id if isinstance(target, ast.Name) and target.id.isupper() else ""


def _change(source: str, start: int, end: int, text: str) -> tuple[str, str]:
    """Return the changed lines before and after, each joined into one line and clipped around the change."""
    first, last = source.rfind("\n", 0, start) + 1, source.find("\n", end)
    before = " ".join(source[first:last].split())
    after = " ".join((source[first:start] + text + source[end:last]).split())
    same = _in_common(before, after)
    tail = _in_common(before[same:][::-1], after[same:][::-1])
    return _cut(before, same, tail), _cut(after, same, tail)


def _in_common(one: str, other: str) -> int:
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False)))


def _cut(text: str, same: int, tail: int) -> str:
    start, end = max(same - _CONTEXT, 0), min(len(text) - tail + _CONTEXT, len(text))
    return ("…" if start else "") + text[start:end] + ("…" if end < len(text) else "")
