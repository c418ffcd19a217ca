"""One source for one run and for many: numbers that are a float, or several side by side.

The parts of the kernel are written once, over numbers that numba takes for either type:

    float64   one run; the readable definition, and the same source uncompiled is its oracle
    Lanes     `WIDTH` runs side by side in a vector register, one operation for all of them

A lane does the operations of a run alone, in the same order, and none of them depends on its
neighbours, so it has the same bits. Lanes can differ only in a condition: one bool, or one for each
lane. Code that must serve both says

    select(c, a, b)    a where c, else b: both are computed, each lane takes its own
    if any_lane(c):    leave out what no lane needs; what follows still selects by c

and writes least, greatest, floor and signed for what Python calls min, max, math.floor and
math.copysign. `+ - * /`, comparisons, `abs`, `&` and `|` are as ever.

Arrays of lanes are plain float64 arrays whose last axis holds the lanes; compiled code sees them
one axis shorter through `as_lanes`, and `x[i]` is then a number of every lane.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import (
    intrinsic as untyped_intrinsic,
)
from numba.extending import (
    lower_builtin,
    lower_cast,
    models,
    overload,
    register_model,
)
from numba.np.arrayobj import populate_array

from zwidth.sim.jit import INLINED

intrinsic: Any = untyped_intrinsic  # the compiler hands it a first argument of its own
WIDTH = 16  # doubles: two registers of 512 bits, since one would wait for its own sums

_INDEX = ir.IntType(32)
_VECTOR = ir.VectorType(ir.DoubleType(), WIDTH)
_CONDITIONS = ir.VectorType(ir.IntType(1), WIDTH)
_BITS = ir.VectorType(ir.IntType(64), WIDTH)


class LanesType(types.Type):
    """`WIDTH` numbers side by side."""

    def __init__(self) -> None:
        super().__init__(name=f"Lanes{WIDTH}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A plain number is the same in every lane."""
        return Conversion.safe if _plain(other) else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is a plain number here and lanes there is lanes."""
        return self if other == self or _plain(other) else None


class ConditionsType(types.Type):
    """`WIDTH` truth values side by side."""

    def __init__(self) -> None:
        super().__init__(name=f"Conditions{WIDTH}")

    def can_convert_from(self, typingctx: Any, other: Any) -> Any:
        """A plain truth value is the same in every lane."""
        same = isinstance(other, types.Boolean)
        return Conversion.safe if same else None

    def unify(self, typingctx: Any, other: Any) -> Any:
        """A variable that is a plain truth value here and one a lane there is one a lane."""
        return self if other == self or isinstance(other, types.Boolean) else None


lanes, conditions = LanesType(), ConditionsType()


def _plain(kind: Any) -> bool:
    return isinstance(kind, types.Float | types.Integer)


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


@register_model(ConditionsType)
class _ConditionsModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _CONDITIONS)


def _spread(builder: Any, value: Any, kind: Any) -> Any:
    """Put one value into every lane."""
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(_INDEX, 0))
    places = ir.Constant(ir.VectorType(_INDEX, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, empty, places)


def _as_vector(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if kind == lanes:
        return value
    return _spread(builder, context.cast(builder, value, kind, types.float64), _VECTOR)


def _as_conditions(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    if kind == conditions:
        return value
    bit = builder.icmp_unsigned("!=", value, ir.Constant(value.type, 0))
    return _spread(builder, bit, _CONDITIONS)


@lower_cast(types.Float, LanesType)
@lower_cast(types.Integer, LanesType)
def _number_to_lanes(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return _as_vector(context, builder, fromty, value)


@lower_cast(types.Boolean, ConditionsType)
def _bool_to_conditions(context: Any, builder: Any, fromty: Any, toty: Any, value: Any) -> Any:
    return _as_conditions(context, builder, fromty, value)


def _define(
    function: Any, make: Callable[[Any, Any, Any], Any], *, of: Any, gives: Any, beside: Any
) -> None:
    """Let an operator take two of a kind, or one of it and what `beside` is."""

    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            fits = len(args) == 2 and of in args and not kws
            if fits and all(a == of or isinstance(a, beside) for a in args):
                return signature(gives, *args)
            return None

    infer_global(function)(Typing)  # pyright: ignore[reportOptionalCall]
    spread = _as_vector if of == lanes else _as_conditions

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        a, b = (spread(context, builder, t, v) for t, v in zip(sig.args, args, strict=True))
        return make(builder, a, b)

    for pair in ((type(of), type(of)), *((type(of), b) for b in beside),
                 *((b, type(of)) for b in beside)):  # fmt: skip
        lower_builtin(function, *pair)(lower)


_NUMBERS, _TRUTHS = (types.Float, types.Integer), (types.Boolean,)
for _functions, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _function in _functions:
        _define(
            _function, lambda builder, a, b, name=_name: getattr(builder, name)(a, b),
            of=lanes, gives=lanes, beside=_NUMBERS,
        )  # fmt: skip
for _function, _sign in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
    (operator.eq, "=="),
):  # fmt: skip
    _define(
        _function, lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b),
        of=lanes, gives=conditions, beside=_NUMBERS,
    )  # fmt: skip
_define(
    operator.ne, lambda builder, a, b: builder.fcmp_unordered("!=", a, b),
    of=lanes, gives=conditions, beside=_NUMBERS,
)  # fmt: skip
for _functions, _name in (
    ((operator.and_, operator.iand), "and_"),
    ((operator.or_, operator.ior), "or_"),
):
    for _function in _functions:
        _define(
            _function, lambda builder, a, b, name=_name: getattr(builder, name)(a, b),
            of=conditions, gives=conditions, beside=_TRUTHS,
        )  # fmt: skip


def _define_unary(function: Any, make: Callable[[Any, Any], Any]) -> None:
    class Typing(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(lanes, lanes) if args == (lanes,) and not kws else None

    infer_global(function)(Typing)  # pyright: ignore[reportOptionalCall]
    lower_builtin(function, LanesType)(lambda context, builder, sig, args: make(builder, args[0]))


_define_unary(operator.neg, lambda builder, a: builder.fneg(a))
_define_unary(abs, lambda builder, a: _call(builder, "llvm.fabs", a))


def _call(builder: Any, name: str, *values: Any) -> Any:
    """Call one of LLVM's own functions, for numbers or for vectors."""
    kind = values[0].type
    full = f"{name}.v{WIDTH}f64" if kind == _VECTOR else f"{name}.f64"
    known = builder.module.globals.get(full)
    shape = ir.FunctionType(kind, [kind] * len(values))
    function = known if known is not None else ir.Function(builder.module, shape, full)
    return builder.call(function, values)


# What follows is called by kernels; uncompiled it is plain Python.


def select(condition: Any, yes: Any, no: Any) -> Any:
    """Return yes where the condition holds, else no; both have been computed."""
    return yes if condition else no


def any_lane(condition: Any) -> bool:
    """Whether the condition holds in any lane."""
    return bool(condition)


def negated(condition: Any) -> Any:
    """Return the contrary of a condition."""
    return not condition


def least(a: Any, b: Any) -> Any:
    """Return b where it is below a, else a: what Python's min does, NaN included."""
    return b if b < a else a


def greatest(a: Any, b: Any) -> Any:
    """Return b where it is above a, else a: what Python's max does, NaN included."""
    return b if b > a else a


def floor(x: Any) -> Any:
    """Return the next whole number below, as a float."""
    return float(math.floor(x)) if math.isfinite(x) else x


def signed(size: Any, sign: Any) -> Any:
    """Return the size with the sign of another number, that of a zero included."""
    return math.copysign(size, sign)


def root(x: Any) -> Any:
    """Return the square root, NaN below zero."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def two_to(n: Any) -> Any:
    """Return 2^n for a whole number -1022 <= n <= 1023."""
    return math.ldexp(1.0, int(n)) if math.isfinite(n) else math.nan


def exponent(x: Any) -> Any:
    """Return the whole number n with 2^n <= x < 2^(n+1), for a normal x > 0."""
    return float(math.frexp(x)[1] - 1) if 0.0 < x < math.inf else 0.0


def first_lane(x: Any) -> Any:
    """Return the number in the first lane, where all lanes have the same."""
    return x


@intrinsic
def _select(typingctx: Any, condition: Any, yes: Any, no: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        c = _as_conditions(context, builder, sig.args[0], args[0])
        a, b = (_as_vector(context, builder, sig.args[i], args[i]) for i in (1, 2))
        return builder.select(c, a, b)

    return signature(lanes, condition, yes, no), generate


@overload(select, strict=False, jit_options=INLINED)
def _select_of(condition: Any, yes: Any, no: Any) -> Any:
    if lanes in (yes, no) or condition == conditions:
        return lambda condition, yes, no: _select(condition, yes, no)
    return lambda condition, yes, no: yes if condition else no


@intrinsic
def _any_of(typingctx: Any, condition: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return signature(types.boolean, condition), generate


@overload(any_lane, strict=False, jit_options=INLINED)
def _any_lane_of(condition: Any) -> Any:
    if condition == conditions:
        return lambda condition: _any_of(condition)
    return lambda condition: condition


@intrinsic
def _not_of(typingctx: Any, condition: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.not_(args[0])

    return signature(conditions, condition), generate


@overload(negated, strict=False, jit_options=INLINED)
def _negated_of(condition: Any) -> Any:
    if condition == conditions:
        return lambda condition: _not_of(condition)
    return lambda condition: not condition


@overload(least, strict=False, jit_options=INLINED)
def _least_of(a: Any, b: Any) -> Any:
    if lanes in (a, b):
        return lambda a, b: _select(b < a, b, a)
    return lambda a, b: b if b < a else a


@overload(greatest, strict=False, jit_options=INLINED)
def _greatest_of(a: Any, b: Any) -> Any:
    if lanes in (a, b):
        return lambda a, b: _select(b > a, b, a)
    return lambda a, b: b if b > a else a


def _intrinsic_of_llvm(name: str, count: int) -> Any:
    """Return an intrinsic for a function that LLVM has for numbers and vectors alike."""

    def typed(args: Any) -> Any:
        kind = lanes if lanes in args else types.float64

        def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            if kind == lanes:
                values = [
                    _as_vector(context, builder, t, v) for t, v in zip(args, values, strict=True)
                ]
            else:
                values = [
                    context.cast(builder, v, t, types.float64)
                    for t, v in zip(args, values, strict=True)
                ]
            return _call(builder, name, *values)

        return signature(kind, *args), generate

    if count == 1:
        return intrinsic(lambda typingctx, x: typed((x,)))
    return intrinsic(lambda typingctx, x, y: typed((x, y)))


_floor_of = _intrinsic_of_llvm("llvm.floor", 1)
_signed_of = _intrinsic_of_llvm("llvm.copysign", 2)
_root_of = _intrinsic_of_llvm("llvm.sqrt", 1)
overload(root, strict=False, jit_options=INLINED)(lambda x: lambda x: _root_of(x))
overload(floor, strict=False, jit_options=INLINED)(lambda x: lambda x: _floor_of(x))
overload(signed, strict=False, jit_options=INLINED)(
    lambda size, sign: lambda size, sign: _signed_of(size, sign)
)


def _on_bits(kind: Any, work: Callable[[Any, Any, Any, Any], Any]) -> Any:
    """Return (signature, generator) of a function that works on the bits of a double."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = kind == lanes
        bits = _BITS if vector else ir.IntType(64)
        back = _VECTOR if vector else ir.DoubleType()

        def constant(value: int) -> Any:
            return ir.Constant(bits, [value] * WIDTH if vector else value)

        return work(builder, args[0], constant, (bits, back))

    return signature(kind, kind), generate


@intrinsic
def _two_to(typingctx: Any, n: Any) -> Any:
    """N + 2^52 + 1023 has n + 1023 in its low bits, which are those of an exponent."""

    def work(builder: Any, n: Any, constant: Any, kinds: Any) -> Any:
        bits, back = kinds
        shifted = builder.fadd(n, _float_constant(back, 2.0**52 + 1023.0))
        return builder.bitcast(builder.shl(builder.bitcast(shifted, bits), constant(52)), back)

    return _on_bits(n, work)


@intrinsic
def _exponent(typingctx: Any, x: Any) -> Any:
    """The exponent's bits, put under those of 2^52, are a number less 2^52."""

    def work(builder: Any, x: Any, constant: Any, kinds: Any) -> Any:
        bits, back = kinds
        high = builder.lshr(builder.bitcast(x, bits), constant(52))
        number = builder.bitcast(builder.or_(high, constant(0x4330000000000000)), back)
        return builder.fsub(number, _float_constant(back, 2.0**52 + 1023.0))

    return _on_bits(x, work)


def _float_constant(kind: Any, value: float) -> Any:
    return ir.Constant(kind, [value] * WIDTH if kind == _VECTOR else value)


overload(two_to, strict=False, jit_options=INLINED)(lambda n: lambda n: _two_to(n))
overload(exponent, strict=False, jit_options=INLINED)(lambda x: lambda x: _exponent(x))


@intrinsic
def _first_of(typingctx: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return builder.extract_element(args[0], ir.Constant(_INDEX, 0))

    return signature(types.float64, x), generate


@overload(first_lane, strict=False, jit_options=INLINED)
def _first_lane_of(x: Any) -> Any:
    if x == lanes:
        return lambda x: _first_of(x)
    return lambda x: x


def _as_lanes(typingctx: Any, array: Any) -> Any:
    """View a float64 array (..., WIDTH) in C order as an array (...) of lanes."""
    if not (isinstance(array, types.Array) and array.dtype == types.float64 and array.ndim > 1):
        return None
    seen = types.Array(lanes, array.ndim - 1, "C", aligned=False)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        source = context.make_array(sig.args[0])(context, builder, args[0])
        target = context.make_array(seen)(context, builder)
        populate_array(
            target,
            data=builder.bitcast(source.data, _VECTOR.as_pointer()),
            shape=cgutils.unpack_tuple(builder, source.shape)[:-1],
            strides=cgutils.unpack_tuple(builder, source.strides)[:-1],
            itemsize=context.get_constant(types.intp, 8 * WIDTH),
            meminfo=None,
        )
        return target._getvalue()

    return signature(seen, array), generate


as_lanes: Any = intrinsic(_as_lanes)


def _lanes_of(typingctx: Any, array: Any) -> Any:
    """Return the lanes that a float64 array (WIDTH,) holds."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        source = context.make_array(sig.args[0])(context, builder, args[0])
        pointer = builder.bitcast(source.data, _VECTOR.as_pointer())
        return builder.load(pointer, align=8)

    return signature(lanes, array), generate


lanes_of: Any = intrinsic(_lanes_of)
