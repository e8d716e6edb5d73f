"""Sixteen float32 side by side, for compiled loops that must not leave the registers.

numba's own vectoriser does not keep a running minimum, and starts each inner loop with checks
that cost more than a short loop. These few operations say what the processor shall do: a value of
type `Lanes` is one AVX-512 register, or two or four smaller ones elsewhere. They work in numba's
nopython mode only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

LANES: Final = 16

_F32 = ir.FloatType()
_VECTOR = ir.VectorType(_F32, LANES)
_WIDE = ir.VectorType(ir.DoubleType(), LANES)
_FLAGS = ("contract", "nsz")

Codegen = Callable[[Any, Any, Any, Any], Any]


def _operation_on_lanes(function: Callable[..., Any]) -> Any:
    """Make a function of numba's types an operation of compiled code."""
    return intrinsic(function)


class LanesType(types.Type):
    """numba's type of sixteen float32."""

    def __init__(self) -> None:
        super().__init__(name="Lanes16xf32")


lanes_type = LanesType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, _VECTOR)  # type: ignore[no-untyped-call]


def _address(context: Any, builder: Any, array_type: Any, array: Any, at: Any, vector: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


def _splat(builder: Any, value: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), None)
    return builder.shuffle_vector(first, undefined, zeros)


def _library(name: str, arguments: int) -> Codegen:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * arguments)
        function = builder.module.declare_intrinsic(f"{name}.v{LANES}f32", (), kind)
        return builder.call(function, args)

    return codegen


def _operation(name: str) -> Codegen:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return getattr(builder, name)(*args, flags=_FLAGS)

    return codegen


@_operation_on_lanes
def load(typing: Any, array: Any, at: Any) -> Any:
    """``array[at : at + 16]`` of a contiguous float32 array; nothing checks the bounds."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, at = args
        value = builder.load(_address(context, builder, signature.args[0], array, at, _VECTOR))
        value.align = 4
        return value

    return lanes_type(array, types.intp), codegen


@_operation_on_lanes
def load_less(typing: Any, array: Any, at: Any, scale: Any, offset: Any) -> Any:
    """``array[at : at + 16] * scale - offset`` of a float64 array, rounded last."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, at, scale, offset = args
        value = builder.load(_address(context, builder, signature.args[0], array, at, _WIDE))
        value.align = 8
        scaled = builder.fmul(value, _splat(builder, scale, _WIDE))
        return builder.fptrunc(builder.fsub(scaled, _splat(builder, offset, _WIDE)), _VECTOR)

    return lanes_type(array, types.intp, types.float64, types.float64), codegen


@_operation_on_lanes
def store(typing: Any, array: Any, at: Any, value: Any) -> Any:
    """``array[at : at + 16] = value``; nothing checks the bounds."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array, at, value = args
        address = _address(context, builder, signature.args[0], array, at, _VECTOR)
        builder.store(value, address).align = 4
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes_type), codegen


@_operation_on_lanes
def splat(typing: Any, value: Any) -> Any:
    """A float32, sixteen times."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _splat(builder, args[0], _VECTOR)

    return lanes_type(types.float32), codegen


@_operation_on_lanes
def add(typing: Any, a: Any, b: Any) -> Any:
    """``a + b``."""
    return lanes_type(lanes_type, lanes_type), _operation("fadd")


@_operation_on_lanes
def sub(typing: Any, a: Any, b: Any) -> Any:
    """``a - b``."""
    return lanes_type(lanes_type, lanes_type), _operation("fsub")


@_operation_on_lanes
def mul(typing: Any, a: Any, b: Any) -> Any:
    """``a * b``."""
    return lanes_type(lanes_type, lanes_type), _operation("fmul")


@_operation_on_lanes
def fma(typing: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c``."""
    return lanes_type(lanes_type, lanes_type, lanes_type), _library("llvm.fmuladd", 3)


@_operation_on_lanes
def absolute(typing: Any, a: Any) -> Any:
    """``|a|``."""
    return lanes_type(lanes_type), _library("llvm.fabs", 1)


@_operation_on_lanes
def root(typing: Any, a: Any) -> Any:
    """Square root of each."""
    return lanes_type(lanes_type), _library("llvm.sqrt", 1)


@_operation_on_lanes
def choose(typing: Any, a: Any, b: Any, x: Any, y: Any) -> Any:
    """``x`` where ``a < b``, else ``y``."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        a, b, x, y = args
        return builder.select(builder.fcmp_ordered("<", a, b), x, y)

    return lanes_type(lanes_type, lanes_type, lanes_type, lanes_type), codegen


def _mask(comparison: str) -> Codegen:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = builder.bitcast(builder.fcmp_ordered(comparison, *args), ir.IntType(LANES))
        return builder.zext(bits, ir.IntType(64))

    return codegen


@_operation_on_lanes
def less(typing: Any, a: Any, b: Any) -> Any:
    """Bit i says whether ``a < b`` in lane i."""
    return types.int64(lanes_type, lanes_type), _mask("<")


@_operation_on_lanes
def at_most(typing: Any, a: Any, b: Any) -> Any:
    """Bit i says whether ``a <= b`` in lane i."""
    return types.int64(lanes_type, lanes_type), _mask("<=")


@_operation_on_lanes
def least(typing: Any, a: Any) -> Any:
    """The least of the sixteen."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_F32, [_VECTOR])
        name = f"llvm.vector.reduce.fmin.v{LANES}f32"
        function = builder.module.declare_intrinsic(name, (), kind)
        return builder.call(function, args, fastmath=("nnan", "nsz"))

    return types.float32(lanes_type), codegen


@_operation_on_lanes
def greatest(typing: Any, a: Any) -> Any:
    """The greatest of the sixteen."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(_F32, [_VECTOR])
        name = f"llvm.vector.reduce.fmax.v{LANES}f32"
        function = builder.module.declare_intrinsic(name, (), kind)
        return builder.call(function, args, fastmath=("nnan", "nsz"))

    return types.float32(lanes_type), codegen


@_operation_on_lanes
def select(typing: Any, bits: Any) -> Any:
    """-1 in the lanes whose bit is set, else 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        mask = ir.VectorType(ir.IntType(1), LANES)
        chosen = builder.bitcast(builder.trunc(args[0], ir.IntType(LANES)), mask)
        minus = ir.Constant(_VECTOR, [-1.0] * LANES)
        return builder.select(chosen, minus, ir.Constant(_VECTOR, [0.0] * LANES))

    return lanes_type(types.int64), codegen


@_operation_on_lanes
def lowest(typing: Any, bits: Any) -> Any:
    """Place of the lowest bit that is set; `bits` is not 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), codegen


@_operation_on_lanes
def count(typing: Any, bits: Any) -> Any:
    """How many bits are set."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.ctpop(args[0])

    return types.int64(types.int64), codegen


@_operation_on_lanes
def square4(typing: Any, a: Any, i: Any, b: Any, j: Any) -> Any:
    """Squared distance of ``a[i : i + 4]`` and ``b[j : j + 4]``, float32 arrays, in float64."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        four = ir.VectorType(_F32, 4)
        wide = ir.VectorType(ir.DoubleType(), 4)
        values = []
        for k in (0, 2):
            address = _address(context, builder, signature.args[k], args[k], args[k + 1], four)
            value = builder.load(address)
            value.align = 4
            values.append(builder.fpext(value, wide))
        difference = builder.fsub(*values)
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType(), wide])
        total = builder.module.declare_intrinsic("llvm.vector.reduce.fadd.v4f64", (), kind)
        zero = ir.Constant(ir.DoubleType(), -0.0)
        squares = builder.fmul(difference, difference)
        return builder.call(total, (zero, squares), fastmath=("reassoc",))

    return types.float64(a, types.intp, b, types.intp), codegen
