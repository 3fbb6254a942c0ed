"""Torch's operations on values one by one, on the card.

What a training step does with images between its shaders is there, in float32, in truth values and in complex numbers;
for other kinds of values an operation is torch's own (`tensors`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from .card import card
from .layout import (
    BOTH,
    CONJUGATED,
    COPY,
    EITHER,
    EQUAL,
    EXPONENTIAL,
    GREATER,
    GREATER_EQUAL,
    IN_PLACE,
    IS_NUMBER,
    LARGER,
    LESS,
    LESS_EQUAL,
    LIMITED,
    LOGISTIC,
    NEITHER,
    NOT_INFINITE,
    POWER,
    PRODUCT,
    QUOTIENT,
    ROOT,
    SIGN,
    SIZE,
    SMALLER,
    SUM,
    UNEQUAL,
    WHERE,
)
from .operands import Operand, belongs_on_card, operand, order, single_numbers
from .tensors import CardTensor, Values, empty, on_card

_aten = torch.ops.aten
#: Largest float32, where a limit is left out.
_LARGEST = float(torch.finfo(torch.float32).max)

Number = float | int


def _number(value: Any) -> Any:
    """A tensor without axes that is known here as a plain number; all else as it is."""
    if isinstance(value, Tensor) and not value.ndim and value.dtype in (torch.float32, torch.bool):
        if not isinstance(value, CardTensor):
            return float(value)
        if not value.held.only_on_card:
            return float(value.local)
    return value


def _is_plain(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _shape(*values: Any) -> tuple[int, ...]:
    shapes = [tuple(value.shape) for value in values if isinstance(value, Tensor)]
    # (numpy's: torch's own loads sympy when it is first asked)
    return shapes[0] if shapes.count(shapes[0]) == len(shapes) else np.broadcast_shapes(*shapes)


def _suits(*values: Any) -> bool:
    """Whether the card does an operation on these: numbers, and tensors of which some lie there."""
    tensors = [value for value in values if not _is_plain(value)]
    mine = all(isinstance(value, CardTensor) and not value.local.is_conj() for value in tensors)
    return mine and belongs_on_card(*tensors)


def _kind(*values: Any) -> torch.dtype | None:
    """Of the result; None where that is not the card's: whole numbers, sums of complex ones and plain ones."""
    kinds = {value.dtype for value in values if isinstance(value, Tensor)}
    if torch.complex64 in kinds:
        return torch.complex64 if kinds <= {torch.complex64, torch.float32} else None
    if torch.float32 in kinds or any(isinstance(value, float) for value in values):
        return torch.float32
    return None


def _operands(values: Sequence[Any], pairs: bool) -> list[Operand | float | None]:
    return [operand(value, pairs) if isinstance(value, Tensor) else value for value in values]


def _elementwise(
    operation: int, values: Sequence[Any], numbers: tuple[float, float] = (0.0, 0.0), out: Tensor | None = None
) -> Any:
    """One operation of up to three tensors or numbers; into the first of them where it is `out`."""
    values = [_number(value) for value in values]
    kind, given = _kind(*values[:2]), [value for value in values if value is not None]
    if kind is None or not _suits(*given):
        return NotImplemented
    shape = _shape(*given) if out is None else tuple(out.shape)
    if out is not None and (kind != out.dtype or _shape(*given) != shape or _shares(out, given[1:])):
        return NotImplemented
    pairs = kind == torch.complex64
    if pairs and (operation not in (SUM, PRODUCT, QUOTIENT, COPY) or not _parts_apart(operation, values)):
        return NotImplemented
    made = empty(*shape, dtype=kind) if out is None else out
    into = operand(made)
    flags = 0 if out is None else IN_PLACE
    done = order("elementwise", operation, into.shape, _operands(values, pairs), into, numbers, flags)
    return made if done else NotImplemented


def _parts_apart(operation: int, values: Sequence[Any]) -> bool:
    """Whether real and imaginary parts of a complex result come from their own kind alone."""
    real = [
        isinstance(value, float | int) or value.dtype != torch.complex64 for value in values[:2] if value is not None
    ]
    if operation == SUM:
        return not any(real)
    return operation == COPY or (not real[0] and real[1])


def _shares(out: Tensor, others: Sequence[Any]) -> bool:
    """Whether another operand lies in the memory that is written: a shader may not bind it twice."""
    return any(isinstance(one, CardTensor) and one.held is out.held for one in others)  # type: ignore[attr-defined]


def _complex_product(a: Any, b: Any, out: Tensor | None = None) -> Any:
    """Of two complex tensors; the second may be a conjugate that was not taken yet."""
    both = all(isinstance(one, CardTensor) and one.dtype == torch.complex64 for one in (a, b))
    if not both or a.local.is_conj() or not belongs_on_card(a, b):
        return NotImplemented
    shape = _shape(a, b)
    if out is not None and (tuple(out.shape) != shape or _shares(out, [b])):
        return NotImplemented
    made = empty(*shape, dtype=torch.complex64) if out is None else out
    one, other, into = (single_numbers(operand(t)) for t in (a, b, made))
    flags = (IN_PLACE if out is not None else 0) | (CONJUGATED if b.local.is_conj() else 0)
    return made if order("multiply", PRODUCT, shape, (one, other, None), into, flags=flags) else NotImplemented


@on_card(_aten.add.Tensor, _aten.add.Scalar)
def _sum(a: Any, b: Any, alpha: Number = 1) -> Any:
    return _elementwise(SUM, (a, b, None), (float(alpha), 0.0))


@on_card(_aten.add_.Tensor, _aten.add_.Scalar)
def _sum_in_place(a: Any, b: Any, alpha: Number = 1) -> Any:
    return _elementwise(SUM, (a, b, None), (float(alpha), 0.0), out=a)


@on_card(_aten.sub.Tensor, _aten.sub.Scalar)
def _difference(a: Any, b: Any, alpha: Number = 1) -> Any:
    return _sum(a, b, -alpha)


@on_card(_aten.sub_.Tensor, _aten.sub_.Scalar)
def _difference_in_place(a: Any, b: Any, alpha: Number = 1) -> Any:
    return _sum_in_place(a, b, -alpha)


@on_card(_aten.rsub.Scalar, _aten.rsub.Tensor)
def _reversed_difference(a: Any, b: Any, alpha: Number = 1) -> Any:
    return _elementwise(SUM, (b, a, None), (-float(alpha), 0.0))


@on_card(_aten.mul.Tensor, _aten.mul.Scalar)
def _product(a: Any, b: Any) -> Any:
    found = _complex_product(a, b)
    if found is not NotImplemented:
        return found
    if all(isinstance(one, Tensor) and one.dtype == torch.bool for one in (a, b)):
        return _truth(BOTH, a, b)
    first = _number(a)
    swapped = _is_plain(first) or (isinstance(first, Tensor) and not first.is_complex())
    return _elementwise(PRODUCT, (b, a, None) if swapped else (a, b, None))


@on_card(_aten.mul_.Tensor, _aten.mul_.Scalar)
def _product_in_place(a: Any, b: Any) -> Any:
    found = _complex_product(a, b, out=a)
    return found if found is not NotImplemented else _elementwise(PRODUCT, (a, b, None), out=a)


@on_card(_aten.div.Tensor, _aten.div.Scalar)
def _quotient(a: Any, b: Any) -> Any:
    return _elementwise(QUOTIENT, (a, b, None))


@on_card(_aten.div_.Tensor, _aten.div_.Scalar)
def _quotient_in_place(a: Any, b: Any) -> Any:
    return _elementwise(QUOTIENT, (a, b, None), out=a)


@on_card(_aten.reciprocal.default)
def _reciprocal(a: Any) -> Any:
    return _elementwise(QUOTIENT, (1.0, a, None))


@on_card(_aten.neg.default)
def _negative(a: Any) -> Any:
    return _elementwise(PRODUCT, (a, -1.0, None)) if a.dtype == torch.float32 else NotImplemented


@on_card(_aten.neg_.default)
def _negative_in_place(a: Any) -> Any:
    return _elementwise(PRODUCT, (a, -1.0, None), out=a) if a.dtype == torch.float32 else NotImplemented


@on_card(_aten.maximum.default)
def _larger(a: Any, b: Any) -> Any:
    return _elementwise(LARGER, (a, b, None))


@on_card(_aten.minimum.default)
def _smaller(a: Any, b: Any) -> Any:
    return _elementwise(SMALLER, (a, b, None))


@on_card(_aten.clamp.default, _aten.clamp_min.default)
def _clamped(a: Any, low: Number | None = None, high: Number | None = None) -> Any:
    limits = -_LARGEST if low is None else float(low), _LARGEST if high is None else float(high)
    return _elementwise(LIMITED, (a, 0.0, None), limits) if a.dtype == torch.float32 else NotImplemented


@on_card(_aten.pow.Tensor_Scalar)
def _power(a: Any, exponent: Number) -> Any:
    if a.dtype != torch.float32:
        return NotImplemented
    if exponent == 2:
        return _elementwise(PRODUCT, (a, a, None))
    if float(exponent).is_integer():  # of negative numbers, too: a shader's power is not
        return NotImplemented
    return _elementwise(POWER, (a, 0.0, None), (float(exponent), 0.0))


def _unary(operation: int) -> Callable[[Any], Any]:
    def function(a: Any) -> Any:
        return _elementwise(operation, (a, 0.0, None)) if a.dtype == torch.float32 else NotImplemented

    return function


for _operation, _name in ((ROOT, "sqrt"), (SIZE, "abs"), (SIGN, "sign"), (EXPONENTIAL, "exp"), (LOGISTIC, "sigmoid")):
    on_card(getattr(_aten, _name).default)(_unary(_operation))


@on_card(_aten.where.self)
def _where(condition: Any, a: Any, b: Any) -> Any:
    if condition.dtype != torch.bool or not isinstance(condition, CardTensor):
        return NotImplemented
    return _elementwise(WHERE, (a, b, condition))


def _truth(operation: int, a: Any, b: Any) -> Any:
    """A truth value of every two values, or of a value and a number."""
    values = [_number(value) for value in (a, b)]
    kinds = {value.dtype for value in values if isinstance(value, Tensor)}
    if not kinds <= {torch.float32, torch.bool} or not _suits(*values):
        return NotImplemented
    shape = _shape(*values)
    made = empty(*shape, dtype=torch.bool)
    done = order("compare", operation, shape, (*_operands(values, False), None), operand(made))
    return made if done else NotImplemented


def _same(a: Any, b: Any) -> bool:
    """Whether both are the very same values, as where it is asked whether they are numbers."""
    if not all(isinstance(one, CardTensor) and one.dtype == torch.float32 for one in (a, b)):
        return False
    return a.held is b.held and operand(a) == operand(b)


@on_card(_aten.eq.Tensor, _aten.eq.Scalar)
def _equal(a: Any, b: Any) -> Any:
    return _truth(IS_NUMBER if _same(a, b) else EQUAL, a, b)


@on_card(_aten.ne.Tensor, _aten.ne.Scalar)
def _unequal(a: Any, b: Any) -> Any:
    if _is_plain(b) and math.isinf(b):  # (asked of sizes only: torch's isfinite)
        return _truth(NOT_INFINITE, a, 0.0)
    return NotImplemented if _same(a, b) else _truth(UNEQUAL, a, b)


def _relation(operation: int) -> Callable[[Any, Any], Any]:
    return lambda a, b: _truth(operation, a, b)


for _operation, _name in ((GREATER, "gt"), (LESS, "lt"), (GREATER_EQUAL, "ge"), (LESS_EQUAL, "le")):
    on_card(getattr(_aten, _name).Tensor, getattr(_aten, _name).Scalar)(_relation(_operation))


def _of_truths(operation: int) -> Callable[[Any, Any], Any]:
    def function(a: Any, b: Any) -> Any:
        both = all(isinstance(one, Tensor) and one.dtype == torch.bool for one in (a, b))
        return _truth(operation, a, b) if both else NotImplemented

    return function


on_card(_aten.bitwise_and.Tensor, _aten.logical_and.default)(_of_truths(BOTH))
on_card(_aten.bitwise_or.Tensor, _aten.logical_or.default)(_of_truths(EITHER))


@on_card(_aten.bitwise_not.default, _aten.logical_not.default)
def _neither(a: Any) -> Any:
    return _truth(NEITHER, a, 0.0) if a.dtype == torch.bool else NotImplemented


@on_card(_aten.clone.default)
def _clone(tensor: Any, memory_format: Any = None) -> Any:
    """A copy on the card, where the values are there; one behind the other."""
    keeps = memory_format in (None, torch.preserve_format)
    if tensor.dtype == torch.bool or not (keeps or memory_format is torch.contiguous_format):
        return NotImplemented
    if keeps and not torch.empty_like(tensor.local).is_contiguous():
        return NotImplemented  # (a copy has the steps of a tensor without gaps)
    if not tensor.is_contiguous() or not tensor.held.on_card or tensor.dtype != torch.float32:
        return _elementwise(COPY, (tensor, None, None))
    made, size = empty(*tensor.shape), 4 * tensor.numel()
    card().copy(tensor.held.for_card(), made.held.for_card(), size, 4 * tensor.local.storage_offset())
    return made


@on_card(_aten.copy_.default)
def _copied(target: Any, source: Any, non_blocking: bool = False) -> Any:
    """Into a tensor of the card; where both are the same there is nothing to do."""
    if not all(isinstance(one, CardTensor) for one in (target, source)):
        return NotImplemented
    if target.held is source.held and operand(target) == operand(source) and target.dtype == source.dtype:
        return target
    simple = target.dtype == torch.float32 and source.dtype in (torch.float32, torch.bool)
    if not simple or not belongs_on_card(source) or _shares(target, [source]):
        return NotImplemented
    # (a sum with zero copies of it would read what was there before)
    done = order("elementwise", COPY, tuple(target.shape), (operand(source), 0.0, None), operand(target))
    return target if done else NotImplemented


@on_card(_aten._to_copy.default)
def _converted(tensor: Any, **options: Any) -> Any:
    """Truth values, or a copy, as float32 on the card."""
    device = options.get("device")
    if device is not None and torch.device(device).type != tensor.device.type:
        return NotImplemented
    if options.get("dtype") not in (None, torch.float32) or not _suits(tensor) or tensor.is_complex():
        return NotImplemented
    if options.get("dtype") is None and tensor.dtype != torch.float32:
        return NotImplemented
    made = empty(*tensor.shape)
    done = order("elementwise", COPY, tuple(tensor.shape), (operand(tensor), 0.0, None), operand(made))
    return made if done else NotImplemented


@on_card(_aten.zeros_like.default)
def _zeros_like(tensor: Any, **options: Any) -> Any:
    """In both places at once: neither has to be brought to the other."""
    if not isinstance(tensor, CardTensor) or options.get("dtype") not in (None, torch.float32) or not tensor.numel():
        return NotImplemented
    if tensor.dtype != torch.float32 or options.get("device") not in (None, tensor.device):
        return NotImplemented
    local = torch.zeros(tensor.shape)
    memory = card().memory(4 * local.numel())
    card().clear(memory)
    return CardTensor(local, Values(local.reshape(-1), memory, on_host=True))


@on_card(_aten._unsafe_view.default)
def _viewed(a: Any, size: Sequence[int]) -> Any:
    """A view: torch's own would be a copy in the computer's memory."""
    return a.view(size)
