"""Translation of compiled parts of the kernel from their own source to C.

The source of a part is evaluated: values fixed by the device (tables, sizes, numbers) are used as
they are, and values known only in a run become C expressions. Conditions on fixed values are
decided and loops over them unrolled, so the C has no branches that the device does not need. The
order of sums is kept, so a compiler that does not contract operations gives the bits of the kernel.
"""

import ast
import inspect
import math
import re
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from zwidth.sim import lane_type

NAMES = re.compile(r"[A-Za-z_]\w*")
C_TYPES = {"d": "double", "i": "long long", "b": "int", "u": "unsigned long long"}
ARITHMETIC: dict[type[ast.operator], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&", ast.BitOr: "|",
    ast.BitXor: "^", ast.RShift: ">>", ast.LShift: "<<", ast.Mod: "%", ast.FloorDiv: "/",
}  # fmt: skip
COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip


class Untranslatable(ValueError):
    """The source of a part cannot be translated to C."""


@dataclass(frozen=True)
class Value:
    """A C expression. Kinds: d a double, i an integer, b a truth value, u an unsigned word."""

    text: str
    kind: str = "d"


@dataclass(frozen=True)
class Array:
    """An array in C, with some of its indices fixed."""

    name: str
    shape: tuple[int, ...]
    indices: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """The number of elements."""
        return math.prod(self.shape)


@dataclass
class _Frame:
    """A call during its translation in place."""

    names: dict[str, Any]
    outer: Mapping[str, Any]
    number: int
    depth: int = 0  # depth of conditions whose outcome is known only in a run
    pinned: list[set[str]] = field(default_factory=list[set[str]])
    results: list[Value] | None = None
    many: bool = False


class _Returned(Exception):
    def __init__(self, value: Any) -> None:
        self.value = value


class _Broken(Exception):
    pass


@cache
def _source(function: Callable[..., Any]) -> ast.FunctionDef:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, SyntaxError):
        raise Untranslatable(f"the source of {function.__name__} cannot be read") from None
    if not isinstance(tree, ast.FunctionDef):
        raise Untranslatable(f"{function.__name__} is not defined by a def statement")
    return tree


def literal(value: Any) -> str:
    """Return a number as a C literal, exact to the bit."""
    if isinstance(value, np.unsignedinteger):
        return f"{int(value)}ULL"
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    if isinstance(value, int | np.integer):
        return f"{int(value)}" if value >= 0 else f"({int(value)})"
    number = float(value)
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "INFINITY" if number > 0.0 else "(-INFINITY)"
    return number.hex() if math.copysign(1.0, number) > 0.0 else f"({number.hex()})"


def _kind(value: Any) -> str:
    if isinstance(value, Value):
        return value.kind
    if isinstance(value, bool | np.bool_):
        return "b"
    if isinstance(value, np.unsignedinteger):
        return "u"
    return "i" if isinstance(value, int | np.integer) else "d"


def _text(value: Any) -> str:
    return value.text if isinstance(value, Value) else literal(value)


class Translator:
    """Translates calls of kernel parts into the body of one C function."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.declared: dict[str, str] = {}
        self._calls = 0
        self._indent = 1

    def emit(self, line: str) -> None:
        """Add a line of C."""
        self.lines.append("    " * self._indent + line)

    def body(self) -> list[str]:
        """Return the declarations and the translated lines."""
        self._drop_unread()
        by_kind: dict[str, list[str]] = {}
        for name, kind in self.declared.items():
            by_kind.setdefault(kind, []).append(name)
        head: list[str] = []
        for kind, names in by_kind.items():
            start = "0.0" if kind == "d" else "0"
            text = ", ".join(f"{name} = {start}" for name in names)
            head += textwrap.wrap(f"{C_TYPES[kind]} {text};", 96, initial_indent="    ",
                                  subsequent_indent="        ")  # fmt: skip
        return head + self.lines

    def _drop_unread(self) -> None:
        """Remove values that are computed and never used."""
        while True:
            asked: set[str] = set()
            for line in self.lines:
                target, equals, rest = line.strip().partition(" = ")
                if equals and target in self.declared:
                    asked |= set(NAMES.findall(rest)) - {target}  # updating itself is no use
                else:
                    asked |= set(NAMES.findall(line))
            unread = self.declared.keys() - asked
            if not unread:
                return
            self.lines = [
                line for line in self.lines if line.strip().partition(" = ")[0] not in unread
            ]
            self.declared = {n: k for n, k in self.declared.items() if n not in unread}

    def call(self, function: Any, *arguments: Any) -> Any:
        """Translate a call in place; return its value, fixed or a C expression.

        Raises Untranslatable.
        """
        plain = getattr(function, "py_func", function)
        if plain in BUILT_IN:
            return BUILT_IN[plain](self, *arguments)
        if not inspect.isfunction(plain):
            raise Untranslatable(f"{plain!r} has no counterpart in C")
        source = _source(plain)
        self._calls += 1
        frame = _Frame({}, plain.__globals__, self._calls)
        for parameter, value in zip(source.args.args, arguments, strict=True):
            self._assign(frame, parameter.arg, value)
        value = None
        try:
            self._block(frame, source.body)
        except _Returned as returned:
            value = returned.value
        if frame.results is not None:
            if value is not None:
                self._give(frame, value)
            self.lines.append(f"end_{frame.number}:;")
            value = tuple(frame.results) if frame.many else (frame.results or [None])[0]
        return value

    def held(self, value: Any, name: str = "t") -> Any:
        """Return a value in a C variable of its own, if it is known only in a run."""
        if not isinstance(value, Value):
            return value
        self._calls += 1
        return self._put(f"{name}_{self._calls}", value)

    def _put(self, name: str, value: Any) -> Value:
        kind = self.declared.setdefault(name, _kind(value))
        if kind != _kind(value):
            if {kind, _kind(value)} == {"i", "b"} or (kind, _kind(value)) == ("d", "i"):
                pass
            else:
                raise Untranslatable(f"{name} is first {kind}, then {_kind(value)}")
        self.emit(f"{name} = {_text(value)};")
        return Value(name, kind)

    def _assign(self, frame: _Frame, name: str, value: Any) -> None:
        if isinstance(value, tuple) and not hasattr(value, "_fields"):
            frame.names[name] = tuple(self.held(v, name) for v in value)
            return
        number = isinstance(value, Value | float | int | bool | np.generic)
        pinned = any(name in names for names in frame.pinned)
        if isinstance(value, Value) or (number and pinned):
            frame.names[name] = self._put(f"{name}_{frame.number}", value)
        elif pinned and frame.names.get(name) is not value:
            raise Untranslatable(f"{name} is a different table in each branch")
        else:
            frame.names[name] = value

    def _give(self, frame: _Frame, value: Any) -> None:
        many = isinstance(value, tuple)
        values = value if many else () if value is None else (value,)
        frame.many = many
        names = [f"result_{frame.number}_{i}" for i in range(len(values))]
        frame.results = [self._put(n, v) for n, v in zip(names, values, strict=True)]

    def _block(self, frame: _Frame, statements: list[ast.stmt]) -> None:
        for statement in statements:
            self._statement(frame, statement)

    def _statement(self, frame: _Frame, statement: ast.stmt) -> None:
        match statement:
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.Expr(value=value):
                self._value(frame, value)
            case ast.Assign(targets=targets, value=value):
                found = self._value(frame, value)
                if len(targets) > 1 or isinstance(targets[0], ast.Tuple):
                    found = (
                        tuple(self.held(v) for v in found)
                        if isinstance(found, tuple) and not hasattr(found, "_fields")
                        else self.held(found)
                    )
                for target in targets:
                    self._store(frame, target, found)
            case ast.AugAssign(target=target, op=op, value=value):
                before = self._value(frame, _as_load(target))
                after = self._operate(type(op), before, self._value(frame, value))
                self._store(frame, target, after)
            case ast.If(test=test, body=body, orelse=orelse):
                self._if(frame, self._value(frame, test), body, orelse)
            case ast.For(target=ast.Name(id=name), iter=iteration, body=body):
                self._for(frame, name, self._value(frame, iteration), body)
            case ast.Return(value=value):
                found = None if value is None else self._value(frame, value)
                if frame.depth == 0:
                    raise _Returned(
                        tuple(self.held(v) for v in found) if isinstance(found, tuple) else found
                    )
                self._give(frame, found)
                self.emit(f"goto end_{frame.number};")
            case ast.Break():
                if frame.depth == 0:
                    raise _Broken
                self.emit("break;")
            case _:
                raise Untranslatable(f"{ast.unparse(statement)!r} has no counterpart in C")

    def _store(self, frame: _Frame, target: ast.expr, value: Any) -> None:
        match target:
            case ast.Name(id=name):
                self._assign(frame, name, value)
            case ast.Tuple(elts=parts):
                for part, one in zip(parts, value, strict=True):
                    self._store(frame, part, one)
            case ast.Subscript(value=array, slice=index):
                place = self._at(self._value(frame, array), self._value(frame, index))
                self.emit(f"{_text(place)} = {_text(value)};")
            case _:
                raise Untranslatable(f"no value can be stored in {ast.unparse(target)!r}")

    def _if(self, frame: _Frame, test: Any, body: list[ast.stmt], orelse: list[ast.stmt]) -> None:
        if not isinstance(test, Value):
            self._block(frame, body if test else orelse)
            return
        test = self.held(test)
        before = self._pin(frame, [*body, *orelse])
        self.emit(f"if ({test.text}) {{")
        self._inner(frame, body)
        if orelse:
            self.emit("} else {")
            self._inner(frame, orelse)
        self.emit("}")
        self._unpin(frame, before)

    def _for(self, frame: _Frame, name: str, steps: range, body: list[ast.stmt]) -> None:
        if name == "_" and len(steps) > 1:
            self._calls += 1
            count = f"n_{self._calls}"
            before = self._pin(frame, body)
            self.emit(f"for (int {count} = 0; {count} < {len(steps)}; {count}++) {{")
            self._inner(frame, body)
            self.emit("}")
            self._unpin(frame, before)
            return
        try:
            for step in steps:
                frame.names[name] = step
                self._block(frame, body)
        except _Broken:
            pass

    def _inner(self, frame: _Frame, body: list[ast.stmt]) -> None:
        frame.depth += 1
        self._indent += 1
        self._block(frame, body)
        self._indent -= 1
        frame.depth -= 1

    def _pin(self, frame: _Frame, body: list[ast.stmt]) -> set[str]:
        """Give what a branch may change a variable; return the names known before it."""
        known = set(frame.names)
        changed: set[str] = set()
        for statement in body:
            for node in ast.walk(statement):
                targets = (
                    node.targets
                    if isinstance(node, ast.Assign)
                    else [node.target] if isinstance(node, ast.AugAssign) else []
                )  # fmt: skip
                changed |= {
                    n.id for t in targets for n in ast.walk(t)
                    if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
                }  # fmt: skip
        pinned = changed & known
        for name in sorted(pinned):
            value = frame.names[name]
            if isinstance(value, float | int | bool | np.generic):
                frame.names[name] = self._put(f"{name}_{frame.number}", value)
        frame.pinned.append(pinned)
        return known

    def _unpin(self, frame: _Frame, known: set[str]) -> None:
        """Forget the names known only inside a branch."""
        frame.pinned.pop()
        for name in set(frame.names) - known:
            if not isinstance(frame.names[name], Value):
                del frame.names[name]

    def _value(self, frame: _Frame, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                return self._named(frame, name)
            case ast.Attribute(value=value, attr=attribute):
                return getattr(self._value(frame, value), attribute)
            case ast.Tuple(elts=parts):
                return tuple(self._value(frame, part) for part in parts)
            case ast.Subscript(value=array, slice=index):
                return self._at(self._value(frame, array), self._value(frame, index))
            case ast.BinOp(left=left, op=op, right=right):
                return self._operate(type(op), self._value(frame, left), self._value(frame, right))
            case ast.UnaryOp(op=op, operand=operand):
                return self._unary(op, self._value(frame, operand))
            case ast.Compare(left=left, ops=ops, comparators=others):
                return self._compare(frame, left, ops, others)
            case ast.BoolOp(op=op, values=values):
                return self._both(frame, isinstance(op, ast.And), values)
            case ast.IfExp(test=test, body=body, orelse=orelse):
                condition = self._value(frame, test)
                if not isinstance(condition, Value):
                    return self._value(frame, body if condition else orelse)
                return select(self, condition, self._value(frame, body), self._value(frame, orelse))
            case ast.Call(func=function, args=arguments, keywords=[]):
                called = self._value(frame, function)
                return self.call(called, *(self._value(frame, a) for a in arguments))
            case _:
                raise Untranslatable(f"{ast.unparse(node)!r} has no counterpart in C")

    def _named(self, frame: _Frame, name: str) -> Any:
        if name in frame.names:
            return frame.names[name]
        if name in frame.outer:
            return frame.outer[name]
        if name in PLAIN:
            return PLAIN[name]
        raise Untranslatable(f"{name!r} is used before it has a value")

    def _at(self, array: Any, index: Any) -> Any:
        indices = index if isinstance(index, tuple) else (index,)
        if not isinstance(array, Array):
            if any(isinstance(i, Value) for i in indices):
                raise Untranslatable("the index of a table is known only at run time")
            found = array[index]
            return found.item() if isinstance(found, np.float64) else found
        given = (*array.indices, *(_text(i) for i in indices))
        rest = array.shape[len(indices) :]
        if rest:
            return Array(array.name, rest, given)
        return Value(array.name + "".join(f"[{i}]" for i in given))

    def _operate(self, op: type[ast.operator], a: Any, b: Any) -> Any:
        if op not in ARITHMETIC:
            raise Untranslatable(f"{op.__name__} has no counterpart in C")
        if not isinstance(a, Value) and not isinstance(b, Value):
            return _known(op, a, b)
        sign, kinds = ARITHMETIC[op], {_kind(a), _kind(b)}
        if kinds == {"b"} and sign in "&|":
            kind = "b"
        elif "d" in kinds or op is ast.Div:
            kind = "d"
            if op is ast.Div and "d" not in kinds:
                return Value(f"((double){_text(a)} / (double){_text(b)})")
        else:
            kind = "u" if "u" in kinds else "i"
        return Value(f"({_text(a)} {sign} {_text(b)})", kind)

    def _unary(self, op: ast.unaryop, a: Any) -> Any:
        if isinstance(op, ast.Not):
            return Value(f"(!{a.text})", "b") if isinstance(a, Value) else not a
        if not isinstance(op, ast.USub):
            raise Untranslatable(f"{type(op).__name__} has no counterpart in C")
        return Value(f"(-{a.text})", a.kind) if isinstance(a, Value) else -a

    def _compare(
        self, frame: _Frame, left: ast.expr, ops: list[ast.cmpop], others: list[ast.expr]
    ) -> Any:
        values = [self._value(frame, node) for node in (left, *others)]
        found: Any = True
        for op, a, b in zip(ops, values[:-1], values[1:], strict=True):
            sign = COMPARISONS.get(type(op))
            if sign is None:
                raise Untranslatable(f"{type(op).__name__} has no counterpart in C")
            if isinstance(a, Value) or isinstance(b, Value):
                one: Any = Value(f"({_text(a)} {sign} {_text(b)})", "b")
            else:
                one = {"<": a < b, "<=": a <= b, ">": a > b, ">=": a >= b, "==": a == b,
                       "!=": a != b}[sign]  # fmt: skip
            found = one if found is True else self._operate(ast.BitAnd, found, one)
        return found

    def _both(self, frame: _Frame, all_of: bool, nodes: list[ast.expr]) -> Any:
        found: list[str] = []
        for node in nodes:
            value = self._value(frame, node)
            if isinstance(value, Value):
                found.append(value.text)
            elif bool(value) != all_of:
                return value
        if not found:
            return all_of
        return Value("(" + (" && " if all_of else " || ").join(found) + ")", "b")


def _as_load(target: ast.expr) -> ast.expr:
    text = ast.unparse(target)
    return ast.parse(text, mode="eval").body


def _known(op: type[ast.operator], a: Any, b: Any) -> Any:
    with np.errstate(all="ignore"):
        if op is ast.Div and not isinstance(b, np.generic) and float(b) == 0.0:
            return float(np.float64(a) / np.float64(b))
        operators: dict[type[ast.operator], Callable[[], Any]] = {
            ast.Add: lambda: a + b, ast.Sub: lambda: a - b, ast.Mult: lambda: a * b,
            ast.Div: lambda: a / b, ast.BitAnd: lambda: a & b, ast.BitOr: lambda: a | b,
            ast.BitXor: lambda: a ^ b, ast.RShift: lambda: a >> b, ast.LShift: lambda: a << b,
            ast.Mod: lambda: a % b, ast.FloorDiv: lambda: a // b,
        }  # fmt: skip
        result = operators[op]()
    return float(result) if isinstance(result, np.float64) else result


def select(into: Translator, condition: Any, yes: Any, no: Any) -> Any:
    """Return yes if the condition holds, else no."""
    if not isinstance(condition, Value):
        return yes if condition else no
    kinds = {_kind(yes), _kind(no)}
    kind = "d" if "d" in kinds else kinds.pop()
    return Value(f"({condition.text} ? {_text(yes)} : {_text(no)})", kind)


def _order(sign: str) -> Callable[..., Any]:
    def chosen(into: Translator, a: Any, b: Any) -> Any:
        if not isinstance(a, Value) and not isinstance(b, Value):
            return (b if b < a else a) if sign == "<" else (b if b > a else a)
        a, b = into.held(a), into.held(b)
        return Value(f"({_text(b)} {sign} {_text(a)} ? {_text(b)} : {_text(a)})")

    return chosen


def _library(name: str, plain: Callable[..., Any]) -> Callable[..., Any]:
    def called(into: Translator, *arguments: Any) -> Any:
        if not any(isinstance(a, Value) for a in arguments):
            return plain(*arguments)
        return Value(f"{name}({', '.join(_text(a) for a in arguments)})")

    return called


def _same(_: Translator, value: Any) -> Any:
    return value


def _contrary(_: Translator, value: Any) -> Any:
    return Value(f"(!{value.text})", "b") if isinstance(value, Value) else not value


def _cast(kind: str, plain: Callable[[Any], Any]) -> Callable[..., Any]:
    def cast(into: Translator, value: Any) -> Any:
        if not isinstance(value, Value):
            return plain(value)
        return value if value.kind == kind else Value(f"(({C_TYPES[kind]}){value.text})", kind)

    return cast


def _range(_: Translator, *bounds: Any) -> range:
    if any(isinstance(b, Value) for b in bounds):
        raise Untranslatable("the length of a loop is known only at run time")
    return range(*(int(b) for b in bounds))


PLAIN: dict[str, Any] = {
    "abs": abs, "int": int, "float": float, "range": range, "True": True, "False": False,
}  # fmt: skip
BUILT_IN: dict[Any, Callable[..., Any]] = {
    lane_type.select: select,
    lane_type.any_lane: _same,
    lane_type.first_lane: _same,
    lane_type.negated: _contrary,
    lane_type.least: _order("<"),
    lane_type.greatest: _order(">"),
    lane_type.floor: _library("floor", lane_type.floor),
    lane_type.signed: _library("copysign", lane_type.signed),
    lane_type.root: _library("sqrt", lane_type.root),
    lane_type.two_to: _library("zwidth_two_to", lane_type.two_to),
    lane_type.exponent: _library("zwidth_exponent", lane_type.exponent),
    abs: _library("fabs", abs),
    int: _cast("i", int),
    float: _cast("d", float),
    np.uint64: _cast("u", np.uint64),
    range: _range,
}
