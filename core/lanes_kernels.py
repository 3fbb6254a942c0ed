"""Sixteen pixels at once: arithmetic on vectors, written as formulas and emitted as LLVM code.

LLVM's own vectoriser gives up on the blending loops (it cannot prove that rows of a buffer do not
overlap, and left the backward pass six times slower). Here a row of 16 pixels is ONE value of type
<16 x float>; LLVM splits it into whatever the processor has (AVX-512, AVX2, NEON). Formulas read
as usual:

    alpha = minimum(opacity * power_of_two(power), ALPHA_MAXIMUM)

Such code stands inside numba intrinsics only (blending, blurs, the photometric loss).
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir

from .constants import TILE

FLOAT = ir.FloatType()
VECTOR = ir.VectorType(FLOAT, TILE)
DOUBLE = ir.DoubleType()
WIDE = ir.VectorType(DOUBLE, TILE)
_INT = ir.IntType(32)
_INT_VECTOR = ir.VectorType(_INT, TILE)
_LONG_VECTOR = ir.VectorType(ir.IntType(64), TILE)

#: Sums may be contracted and reordered; NaN and infinity keep their meaning.
_FLAGS = ("contract", "reassoc", "nsz", "arcp")

#: Minimax polynomial of 2**f on [-0.5, 0.5], relative error 8e-8.
_EXP2 = (
    1.0000000716546416,
    0.6931469670652649,
    0.2402211972396918,
    0.0555071327287539,
    0.0096755413310214,
    0.0013276472167820,
)


class Lanes:
    """A float32 (or float64) scalar or a vector of 16, with the operators of arithmetic."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder = builder
        self.value = value

    @staticmethod
    def kind() -> ir.Type:
        """The type of 16 floats, for memory that holds them."""
        return VECTOR

    @property
    def is_vector(self) -> bool:
        """Whether this is 16 values rather than one."""
        return isinstance(self.value.type, ir.VectorType)

    @property
    def element(self) -> ir.Type:
        """The type of one lane."""
        return self.value.type.element if self.is_vector else self.value.type

    def wide(self) -> Lanes:
        """This value in all 16 lanes."""
        if self.is_vector:
            return self
        nothing = ir.Constant(ir.VectorType(self.element, TILE), ir.Undefined)
        seed = self.builder.insert_element(nothing, self.value, ir.Constant(_INT, 0))
        return Lanes(self.builder, self.builder.shuffle_vector(seed, nothing, ir.Constant(_INT_VECTOR, [0] * TILE)))

    def like(self, number: float) -> Lanes:
        """A constant of this one's kind."""
        return Lanes(self.builder, ir.Constant(self.element, float(number)))

    def double(self) -> Lanes:
        """A vector in double precision."""
        return Lanes(self.builder, self.builder.fpext(self.value, WIDE))

    def single(self) -> Lanes:
        """A vector rounded to float32."""
        return Lanes(self.builder, self.builder.fptrunc(self.value, VECTOR))

    def _pair(self, other: Lanes | float) -> tuple[ir.Value, ir.Value]:
        if not isinstance(other, Lanes):
            other = self.like(other)
        if self.is_vector or other.is_vector:
            return self.wide().value, other.wide().value
        return self.value, other.value

    def _apply(self, operation: str, other: Lanes | float, swap: bool = False) -> Lanes:
        left, right = self._pair(other)
        if swap:
            left, right = right, left
        return Lanes(self.builder, getattr(self.builder, operation)(left, right, flags=_FLAGS))

    def __add__(self, other: Lanes | float) -> Lanes:
        return self._apply("fadd", other)

    def __sub__(self, other: Lanes | float) -> Lanes:
        return self._apply("fsub", other)

    def __mul__(self, other: Lanes | float) -> Lanes:
        return self._apply("fmul", other)

    def __truediv__(self, other: Lanes | float) -> Lanes:
        return self._apply("fdiv", other)

    def __rtruediv__(self, other: float) -> Lanes:
        return self._apply("fdiv", other, swap=True)

    def __neg__(self) -> Lanes:
        return -1.0 * self

    def __radd__(self, other: float) -> Lanes:
        return self._apply("fadd", other, swap=True)

    def __rsub__(self, other: float) -> Lanes:
        return self._apply("fsub", other, swap=True)

    def __rmul__(self, other: float) -> Lanes:
        return self._apply("fmul", other, swap=True)

    def rounded(self, operation: str, other: Lanes) -> Lanes:
        """'fadd' or 'fmul' in exactly this order, where two ways to one number must agree to the bit."""
        return Lanes(self.builder, getattr(self.builder, operation)(*self._pair(other)))

    def fused(self, factor: Lanes | float, total: Lanes) -> Lanes:
        """self * factor + total of vectors in exactly this order, in one instruction where there is one."""
        left, right = self._pair(factor)
        name = f"llvm.fmuladd.v{TILE}f32"
        function = _declare(self.builder, name, VECTOR, [VECTOR, VECTOR, VECTOR])
        return Lanes(self.builder, self.builder.call(function, [left, right, total.wide().value]))

    def over(self, divisor: Lanes) -> Lanes:
        """self / divisor where both are finite: a reciprocal estimate and one step, good to 2e-7, or a division."""
        left, right = self._pair(divisor)
        return Lanes(self.builder, self.builder.fdiv(left, right, flags=(*_FLAGS, "ninf")))

    def compare(self, relation: str, other: Lanes | float) -> ir.Value:
        """A mask (or a single bit, for scalars) where `self relation other` holds."""
        left, right = self._pair(other)
        return self.builder.fcmp_ordered(relation, left, right)

    def sum(self) -> Lanes:
        """The sum over the 16 lanes, as a scalar."""
        name = f"llvm.vector.reduce.fadd.v{TILE}f32"
        function = _declare(self.builder, name, FLOAT, [FLOAT, VECTOR])
        start = ir.Constant(FLOAT, -0.0)
        return Lanes(self.builder, self.builder.call(function, [start, self.value], fastmath=("reassoc",)))

    def maximum(self) -> Lanes:
        """The largest of the 16 lanes, as a scalar."""
        function = _declare(self.builder, f"llvm.vector.reduce.fmax.v{TILE}f32", FLOAT, [VECTOR])
        return Lanes(self.builder, self.builder.call(function, [self.value]))


def _declare(builder: ir.IRBuilder, name: str, result: ir.Type, arguments: list[ir.Type]) -> ir.Function:
    module = builder.module
    found = module.globals.get(name)
    return found if found is not None else ir.Function(module, ir.FunctionType(result, arguments), name)


def constant(builder: ir.IRBuilder, number: float) -> Lanes:
    """A scalar constant."""
    return Lanes(builder, ir.Constant(FLOAT, float(number)))


def ramp(builder: ir.IRBuilder) -> Lanes:
    """0, 1, 2, ... 15."""
    return Lanes(builder, ir.Constant(VECTOR, [float(i) for i in range(TILE)]))


def choose(mask: ir.Value, where: Lanes, otherwise: Lanes | float) -> Lanes:
    """`where` under the mask, `otherwise` elsewhere."""
    left, right = where._pair(otherwise)
    return Lanes(where.builder, where.builder.select(mask, left, right))


def minimum(left: Lanes, right: Lanes | float) -> Lanes:
    """The smaller of two; `right` where one is NaN."""
    a, b = left._pair(right)
    return Lanes(left.builder, left.builder.select(left.builder.fcmp_ordered("<", a, b), a, b))


def maximum(left: Lanes, right: Lanes | float) -> Lanes:
    """The larger of two; `right` where one is NaN."""
    a, b = left._pair(right)
    return Lanes(left.builder, left.builder.select(left.builder.fcmp_ordered(">", a, b), a, b))


def power_of_two(x: Lanes) -> Lanes:
    """2**x of a vector, relative error 2e-7, for x <= 127; below -126 as at -126 (1.2e-38)."""
    builder = x.builder
    x = maximum(x, -126.0)
    rounding = _declare(builder, f"llvm.rint.v{TILE}f32", VECTOR, [VECTOR])
    n = Lanes(builder, builder.call(rounding, [x.value]))
    f = x - n
    series = constant(builder, _EXP2[-1]).wide()
    for coefficient in reversed(_EXP2[:-1]):
        series = series * f + coefficient
    whole = builder.shl(builder.fptosi(n.value, _INT_VECTOR), ir.Constant(_INT_VECTOR, [23] * TILE))
    bits = builder.add(builder.bitcast(series.value, _INT_VECTOR), whole)  # times 2**n
    return Lanes(builder, builder.bitcast(bits, VECTOR))


def root(x: Lanes) -> Lanes:
    """The square root of a vector."""
    kind = "f64" if x.element == DOUBLE else "f32"
    function = _declare(x.builder, f"llvm.sqrt.v{TILE}{kind}", x.value.type, [x.value.type])
    return Lanes(x.builder, x.builder.call(function, [x.value]))


def exponential(x: Lanes) -> Lanes:
    """exp(x) of a vector in double precision, relative error 1e-12; x is limited to +-600."""
    builder = x.builder
    x = minimum(maximum(x * (1.0 / math.log(2.0)), -865.0), 865.0)
    n = Lanes(builder, builder.call(_declare(builder, f"llvm.rint.v{TILE}f64", WIDE, [WIDE]), [x.value]))
    f = x - n
    terms = [math.log(2.0) ** k / math.factorial(k) for k in range(11)]
    series = f * terms[-1] + terms[-2]
    for term in reversed(terms[:-2]):
        series = series * f + term
    whole = builder.sext(builder.fptosi(n.value, _INT_VECTOR), _LONG_VECTOR)
    bits = builder.add(builder.bitcast(series.value, _LONG_VECTOR), builder.shl(whole, _long(52)))
    return Lanes(builder, builder.bitcast(bits, WIDE))


def logarithm(x: Lanes) -> Lanes:
    """log(x) of a vector of normal positive doubles, error 1e-9."""
    builder = x.builder
    bits = builder.bitcast(x.value, _LONG_VECTOR)
    whole = builder.trunc(builder.sub(builder.lshr(bits, _long(52)), _long(1023)), _INT_VECTOR)
    bits = builder.or_(builder.and_(bits, _long((1 << 52) - 1)), _long(1023 << 52))
    m = Lanes(builder, builder.bitcast(bits, WIDE))  # in [1, 2)
    t = (m - math.sqrt(2.0)) / (m + math.sqrt(2.0))
    tt = t * t
    series = (((tt * (1 / 11) + 1 / 9) * tt + 1 / 7) * tt + 1 / 5) * tt + 1 / 3
    exponent = Lanes(builder, builder.sitofp(whole, WIDE)) + 0.5
    return exponent * math.log(2.0) + 2.0 * t * (series * tt + 1.0)


def _long(number: int) -> ir.Constant:
    return ir.Constant(_LONG_VECTOR, [number] * TILE)


class Buffer:
    """A float32 (or float64) array seen as rows of 16."""

    def __init__(self, context: Any, builder: ir.IRBuilder, array_type: Any, array: ir.Value) -> None:
        self.builder = builder
        self.data = context.make_array(array_type)(context, builder, array).data
        self.element = context.get_data_type(array_type.dtype)
        self.vector = ir.VectorType(self.element, TILE)

    def _pointer(self, index: ir.Value, plane: int, kind: ir.Type) -> ir.Value:
        builder = self.builder
        where = builder.add(index, ir.Constant(index.type, plane)) if plane else index
        return builder.bitcast(builder.gep(self.data, [where]), kind.as_pointer())

    def row(self, index: ir.Value, plane: int = 0) -> Lanes:
        """16 values from element `index + plane` on."""
        return Lanes(self.builder, self.builder.load(self._pointer(index, plane, self.vector), align=4))

    def put_row(self, index: ir.Value, plane: int, lanes: Lanes) -> None:
        """Stores 16 values from element `index + plane` on."""
        self.builder.store(lanes.value, self._pointer(index, plane, self.vector), align=4)

    def one(self, index: ir.Value, plane: int = 0) -> Lanes:
        """The single value at element `index + plane`."""
        return Lanes(self.builder, self.builder.load(self._pointer(index, plane, self.element), align=4))

    def put_first(self, index: ir.Value, lanes: Lanes, count: int) -> None:
        """Stores the first `count` lanes (at least 8) from element `index` on."""
        builder, half = self.builder, ir.VectorType(FLOAT, 8)
        eight = builder.shuffle_vector(lanes.value, lanes.value, ir.Constant(ir.VectorType(_INT, 8), list(range(8))))
        builder.store(eight, self._pointer(index, 0, half), align=4)
        for lane in range(8, count):
            one = builder.extract_element(lanes.value, ir.Constant(_INT, lane))
            builder.store(one, self._pointer(index, lane, FLOAT), align=4)

    def prefetch(self, index: ir.Value) -> None:
        """Asks for the cache line of element `index`."""
        builder = self.builder
        pointer = self._pointer(index, 0, ir.IntType(8))
        function = _declare(builder, "llvm.prefetch.p0", ir.VoidType(), [pointer.type, _INT, _INT, _INT])
        builder.call(function, [pointer, ir.Constant(_INT, 0), ir.Constant(_INT, 3), ir.Constant(_INT, 1)])


class Rows:
    """Float32 memory by address: rows whose addresses stand in an int64 table, or 16 floats per row."""

    def __init__(self, builder: ir.IRBuilder, base: ir.Value, column: ir.Value | None = None) -> None:
        """base: pointer to the table (with `column`: bytes into each row), or an address as integer."""
        self.builder, self.base, self.column = builder, base, column

    def pointer(self, index: ir.Value) -> ir.Value:
        """Pointer to 16 floats of row `index`."""
        builder = self.builder
        if self.column is not None:
            address = builder.add(builder.load(builder.gep(self.base, [index])), self.column)
        else:
            address = builder.add(self.base, builder.mul(index, ir.Constant(index.type, 4 * TILE)))
        return builder.inttoptr(address, VECTOR.as_pointer())

    def __getitem__(self, index: ir.Value) -> Lanes:
        return Lanes(self.builder, self.builder.load(self.pointer(index), align=4))

    def __setitem__(self, index: ir.Value, lanes: Lanes) -> None:
        self.builder.store(lanes.value, self.pointer(index), align=4)


def shuffled(left: Lanes, right: Lanes, order: list[int]) -> Lanes:
    """Lanes picked from `left` (0 to 15) and `right` (16 to 31)."""
    mask = ir.Constant(_INT_VECTOR, order)
    return Lanes(left.builder, left.builder.shuffle_vector(left.value, right.value, mask))


def transposed(rows: list[Lanes]) -> list[Lanes]:
    """Column `k` of 16 rows as vector number `k`, in four rounds of shuffles that processors have."""
    pairs = [
        shuffled(
            rows[i],
            rows[i + 1],
            _order(lambda b, part=part: [4 * b + part, TILE + 4 * b + part, 4 * b + part + 1, TILE + 4 * b + part + 1]),
        )
        for i in range(0, TILE, 2)
        for part in (0, 2)
    ]
    fours = []  # fours[4 g + k]: block b holds column 4 b + k of rows 4 g to 4 g + 3
    for g in range(4):
        low, high, low2, high2 = pairs[4 * g : 4 * g + 4]
        for a, b in ((low, low2), (high, high2)):
            for part in (0, 2):
                fours.append(
                    shuffled(
                        a,
                        b,
                        _order(
                            lambda n, part=part: [
                                4 * n + part,
                                4 * n + part + 1,
                                TILE + 4 * n + part,
                                TILE + 4 * n + part + 1,
                            ]
                        ),
                    )
                )
    columns: list[Lanes] = [rows[0]] * TILE
    for k in range(4):
        for odd in (0, 1):
            upper, lower = (shuffled(fours[4 * g + k], fours[4 * g + 4 + k], _blocks(odd)) for g in (0, 2))
            for half in (0, 1):
                columns[4 * (odd + 2 * half) + k] = shuffled(upper, lower, _blocks(half))
    return columns


def sums_of(rows: list[Lanes]) -> Lanes:
    """One vector whose lane `k` is the sum over `rows[k]` (at most 16), half the shuffles of as many `sum`s."""
    count = len(rows)
    for step in (8, 4, 2, 1):  # lanes without this bit go on with the left vector, lanes with it with the right
        stay = [lane + (TILE if lane & step else 0) for lane in range(TILE)]
        cross = [(lane ^ step) + (TILE if lane & step else 0) for lane in range(TILE)]
        pairs = [(rows[i], rows[min(i + 1, len(rows) - 1)]) for i in range(0, len(rows), 2)]
        rows = [shuffled(a, b, stay) + shuffled(a, b, cross) for a, b in pairs]
    places = [int(f"{k:04b}"[::-1], 2) for k in range(TILE)]
    return shuffled(rows[0], rows[0], [places[k] if k < count else 0 for k in range(TILE)])


def _order(block: Any) -> list[int]:
    return [lane for n in range(4) for lane in block(n)]


def _blocks(first: int) -> list[int]:
    """Blocks of four lanes: number `first` and the next but one, of either vector."""
    return [start + 4 * n + lane for start in (0, TILE) for n in (first, first + 2) for lane in range(4)]


class Running:
    """Vectors that a loop adds to; they stay in registers."""

    def __init__(self, builder: ir.IRBuilder, count: int) -> None:
        self.builder = builder
        self.slots = []
        for _ in range(count):
            with builder.goto_entry_block():
                slot = builder.alloca(VECTOR)
            builder.store(ir.Constant(VECTOR, [0.0] * TILE), slot)
            self.slots.append(slot)

    def add(self, position: int, lanes: Lanes) -> None:
        """Adds to sum number `position`."""
        slot = self.slots[position]
        self.builder.store((Lanes(self.builder, self.builder.load(slot)) + lanes).value, slot)

    def __getitem__(self, position: int) -> Lanes:
        return Lanes(self.builder, self.builder.load(self.slots[position]))

    def __setitem__(self, position: int, lanes: Lanes) -> None:
        self.builder.store(lanes.wide().value, self.slots[position])
