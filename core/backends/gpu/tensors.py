"""Torch tensors whose values lie on the card: torch's device 'gpu'.

A `CardTensor` looks to torch like a tensor of a device of its own. What there is a shader for is done on the card;
every other operation of torch is done by torch itself in the computer's memory, where the values are brought for it,
and from where they go back when a shader needs them next. So everything works from the first day, and what crosses
the bus is counted (`card.Traffic`).

    Values      one tensor's values, in the computer's memory, on the card, or in both places
    CardTensor  a tensor, or a view of a part of it: views share their `Values`
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

from .card import Card, Memory, card

#: What torch calls the card.
DEVICE = "gpu"
#: Torch's module of tensors that lie on several machines.
_DISTRIBUTED = "torch.distributed.tensor"
_aten = torch.ops.aten
#: Operations that read no values of their arguments.
_SHAPE_ONLY = {
    _aten.new_zeros.default,
    _aten.new_empty.default,
    _aten.new_empty_strided.default,
    _aten.new_full.default,
    _aten.new_ones.default,
    _aten.zeros_like.default,
    _aten.ones_like.default,
    _aten.empty_like.default,
    _aten.full_like.default,
}
#: Operations that overwrite all values of their first argument.
_OVERWRITING = {
    _aten.zero_.default,
    _aten.fill_.Scalar,
    _aten.fill_.Tensor,
    _aten.copy_.default,
    _aten._copy_from.default,
}
#: Operations that make a tensor from nothing: torch asks the device itself for them.
_FACTORIES = ("empty.memory_format", "empty_strided", "arange", "arange.start", "arange.start_step")


class Values:
    """One tensor's values and all its views'.

    Attributes:
        host: [n] flat, in the computer's memory; untouched until it is needed there.
        on_card: whether they lie on the card as they are now.
    """

    def __init__(self, host: Tensor, memory: Memory | None = None, on_host: bool = False) -> None:
        self.host, self._memory = host, memory
        self._on_host, self.on_card = on_host or memory is None, memory is not None

    @property
    def only_on_card(self) -> bool:
        """Whether the computer's memory does not hold them as they are now."""
        return self.on_card and not self._on_host

    def for_host(self, overwrite: bool = False) -> None:
        """Brings them to the computer's memory."""
        if not self._on_host and not overwrite:
            assert self._memory is not None
            raw = card().read(self._memory, self.host.numel() * self.host.element_size())
            self.host.numpy().view(np.uint8).reshape(-1)[:] = raw
        self._on_host = True

    def changed_on_host(self) -> None:
        """They were written in the computer's memory."""
        self.on_card = False

    def for_card(self, overwrite: bool = False) -> Memory:
        """Brings them to the card; `overwrite` where all of them will be written there."""
        if self._memory is None:
            self._memory = card().memory(self.host.numel() * self.host.element_size())
        if not self.on_card and not overwrite:
            card().write(self._memory, self.host.numpy())
        self.on_card = True
        return self._memory

    def changed_on_card(self) -> None:
        """They were written on the card."""
        self._on_host = False


class CardTensor(Tensor):
    """A tensor on the card; see the module."""

    held: Values
    local: Tensor
    # (torch's own hands every method and attribute through Python)
    __torch_function__ = torch._C._disabled_torch_function_impl  # type: ignore[assignment]

    @staticmethod
    def __new__(cls, local: Tensor, values: Values) -> CardTensor:
        made: CardTensor = torch.Tensor._make_wrapper_subclass(  # type: ignore[attr-defined]
            cls,
            local.shape,
            strides=local.stride(),
            storage_offset=local.storage_offset(),
            dtype=local.dtype,
            device=torch.device(DEVICE, 0),
        )
        made.local, made.held = local, values
        return made

    @classmethod
    def __torch_dispatch__(  # type: ignore[override]
        cls, operation: Any, types: Iterable[type], args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        kernel = _KERNELS.get(operation)
        if kernel is not None:
            found = kernel(*args, **(kwargs or {}))
            if found is not NotImplemented:
                return found
        elif operation in _VIEWS:
            seen: CardTensor = args[0]
            return CardTensor(operation(seen.local, *args[1:], **(kwargs or {})), seen.held)
        return _by_torch(operation, args, dict(kwargs or {}))

    def tolist(self) -> Any:
        """Its values as Python's lists."""
        return self.cpu().tolist()

    def __repr__(self, *, tensor_contents: Any = None) -> str:  # type: ignore[override]
        self.held.for_host()
        return f"CardTensor({self.local!r})"


#: Operations whose result is one part of their first argument: the most frequent ones, of which no value is touched.
_VIEWS = frozenset(
    {
        _aten.detach.default,
        _aten.view.default,
        _aten.slice.Tensor,
        _aten.select.int,
        _aten.unsqueeze.default,
        _aten.squeeze.dim,
        _aten.permute.default,
        _aten.transpose.int,
        _aten.t.default,
        _aten.expand.default,
        _aten.as_strided.default,
        _aten.alias.default,
    }
)
#: Operations of torch that the card does itself; NotImplemented where it does not for these arguments.
_KERNELS: dict[Any, Callable[..., Any]] = {}


def on_card(*operations: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Says that a function does these operations of torch on the card."""

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        _KERNELS.update(dict.fromkeys(operations, function))
        return function

    return register


def from_host(local: Tensor) -> CardTensor:
    """A tensor of the computer's memory as one of the card; nothing is copied yet."""
    if not local.is_contiguous() or local.storage_offset():
        local = local.contiguous().clone()
    return CardTensor(local, Values(local.reshape(-1)))


def empty(*shape: int, dtype: torch.dtype = torch.float32) -> CardTensor:
    """[shape] on the card, whatever stands in it; for a shader to write."""
    local = torch.empty(shape, dtype=dtype)
    return CardTensor(local, Values(local.reshape(-1), card().memory(local.element_size() * local.numel())))


def for_shader(tensor: Tensor) -> Memory:
    """The memory of a float32 tensor as shaders read it: row by row, from the beginning.

    Brings it to the card if it is not there; copies what is a part of another tensor.
    """
    if isinstance(tensor, CardTensor) and _lies_whole(tensor):
        return tensor.held.for_card()
    tensor = tensor.detach()
    if not isinstance(tensor, CardTensor):
        tensor = from_host(tensor)
    if tensor.dtype != torch.float32:
        tensor = tensor.float()
    if not tensor.is_contiguous() or tensor.storage_offset():
        # (below torch's own dispatch, where this may be called, `contiguous` would be taken for a view)
        tensor = tensor.clone(memory_format=torch.contiguous_format)
    assert isinstance(tensor, CardTensor)
    return tensor.held.for_card()


def part_for_shader(tensor: Tensor) -> tuple[Memory, int]:
    """As `for_shader`, but a part of another tensor stays where it is: the memory, and at which value it begins."""
    local = tensor.local if isinstance(tensor, CardTensor) else None
    if isinstance(tensor, CardTensor) and local is not None and local.dtype == torch.float32 and local.is_contiguous():
        return tensor.held.for_card(), int(local.storage_offset())
    return for_shader(tensor), 0


def _lies_whole(tensor: CardTensor) -> bool:
    """Whether its memory begins with its values, float32 and row by row."""
    local = tensor.local
    return local.dtype == torch.float32 and local.is_contiguous() and not local.storage_offset()


def bytes_for_shader(tensor: Tensor) -> Memory:
    """The memory of a tensor of truth values, a byte each, row by row."""
    tensor = tensor.detach()
    if not isinstance(tensor, CardTensor) or not tensor.is_contiguous() or tensor.storage_offset():
        tensor = from_host(tensor.cpu())
    assert isinstance(tensor, CardTensor) and tensor.dtype == torch.bool
    return tensor.held.for_card()


def in_place(tensor: Tensor) -> Memory:
    """The memory of a tensor that a shader reads and changes: float32, or int32 where it counts."""
    if not isinstance(tensor, CardTensor) or not tensor.is_contiguous() or tensor.storage_offset():
        raise ValueError("only a whole tensor of the card is changed in place")
    memory = tensor.held.for_card()
    tensor.held.changed_on_card()
    return memory


def written(tensor: CardTensor) -> CardTensor:
    """Notes that a shader wrote a tensor."""
    tensor.held.changed_on_card()
    return tensor


@dataclass(frozen=True)
class _Operation:
    """What is to be known of an operation of torch's.

    Attributes:
        names: of its arguments; changes: of those that it writes.
        view: whether its result is a part of an argument; into: whether its result is an argument that it wrote.
    """

    names: tuple[str, ...]
    changes: tuple[str, ...]
    view: bool
    into: bool


@cache
def _known(operation: Any) -> _Operation:
    schema = operation._schema
    alias = schema.returns[0].alias_info if schema.returns else None
    written = tuple(a.name for a in schema.arguments if a.alias_info is not None and a.alias_info.is_write)
    names = tuple(argument.name for argument in schema.arguments)
    return _Operation(names, written, alias is not None and not alias.is_write, alias is not None and alias.is_write)


def _by_torch(operation: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
    """Does an operation in the computer's memory."""
    known, changed = _known(operation), []
    if known.changes:
        given = dict(zip(known.names, args, strict=False)) | kwargs
        changed = [given[name] for name in known.changes if isinstance(given.get(name), CardTensor)]
    if not known.view and operation not in _SHAPE_ONLY:
        for tensor in _card_tensors((args, *kwargs.values())):
            whole = tensor.local.numel() == tensor.held.host.numel()
            tensor.held.for_host(operation in _OVERWRITING and tensor is args[0] and whole)
    asked = kwargs.get("device")
    if asked is not None:
        kwargs["device"] = torch.device("cpu")
    found = operation(*_local(args), **{name: _local(value) for name, value in kwargs.items()})
    for tensor in changed:
        tensor.held.changed_on_host()
    if changed:
        return changed[0] if len(changed) == 1 else tuple(changed)
    if known.into:
        return args[0]  # a tensor of the computer's memory was written
    if asked is not None and torch.device(asked).type != DEVICE:
        return found
    if known.view:
        values = next(_card_tensors(args)).held
        return _each(found, lambda local: CardTensor(local, values))
    return _each(found, from_host)


def _local(tree: Any) -> Any:
    """Arguments of an operation, tensors of the card as they are in the computer's memory."""
    if isinstance(tree, CardTensor):
        return tree.local
    return type(tree)(_local(leaf) for leaf in tree) if type(tree) in (list, tuple) else tree


def _each(found: Any, make: Callable[[Tensor], CardTensor]) -> Any:
    """Results of an operation, every tensor made one of the card."""
    if isinstance(found, Tensor):
        return make(found)
    if isinstance(found, list | tuple):
        return type(found)(_each(one, make) for one in found)
    return found


def _card_tensors(tree: Any) -> Iterator[CardTensor]:
    if isinstance(tree, CardTensor):
        yield tree
    elif type(tree) in (list, tuple):
        for leaf in tree:
            yield from _card_tensors(leaf)


def register() -> Card:
    """Makes 'gpu' a device of torch's, and opens the card; every thread that trains there calls it.

    Raises:
        DeviceError: there is none.
    """
    found = card()
    _registered()
    # Backward passes run on the thread that asks for them: torch's own threads for each device are made once, at the
    # first backward pass of a process, which may have been before. (Each thread has this setting of its own.)
    torch.autograd.set_multithreading_enabled(False)
    return found


@cache
def _registered() -> None:
    _setup_privateuseone_for_python_backend(DEVICE)  # type: ignore[no-untyped-call]
    for name in _FACTORIES:
        packet, _, overload = name.partition(".")
        _LIBRARY.impl(name, _factory(getattr(getattr(_aten, packet), overload or "default")), "PrivateUse1")
    _LIBRARY.impl("_copy_from", _copy_from, "PrivateUse1")
    _dispatched_for_the_first_time()


def _dispatched_for_the_first_time() -> None:
    """Has torch meet a tensor of a Python class.

    To know its own distributed tensors from others, torch then loads them, with all of sympy: 0.7 s of a processor,
    2 s where nothing is compiled yet. Nobody in this process has such tensors, unless they are loaded already: an empty
    class takes their place while torch looks.
    """
    stands_in = ModuleType(_DISTRIBUTED)
    stands_in.DTensor = type("DTensor", (), {})  # type: ignore[attr-defined]
    known = sys.modules.setdefault(_DISTRIBUTED, stands_in)
    try:
        from_host(torch.zeros(1)).detach()
    except (AttributeError, ImportError):
        pass  # (a torch that looks for more than the class: it loads its own when it looks again)
    finally:
        if known is stands_in:
            del sys.modules[_DISTRIBUTED]


_LIBRARY = torch.library.Library("aten", "IMPL")


def _factory(operation: Any) -> Callable[..., CardTensor]:
    def make(*args: Any, **kwargs: Any) -> CardTensor:
        kwargs["device"] = torch.device("cpu")
        kwargs.pop("pin_memory", None)
        return from_host(operation(*args, **kwargs))

    return make


def _copy_from(source: Tensor, target: Tensor, non_blocking: bool = False) -> Tensor:
    """torch.tensor(..., device='gpu') comes here, past the tensors' own dispatch."""
    if isinstance(source, CardTensor):
        source.held.for_host()
    if isinstance(target, CardTensor):
        target.held.for_host()
    _place_of(target).copy_(_place_of(source))
    if isinstance(target, CardTensor):
        target.held.changed_on_host()
    return target


def _place_of(tensor: Tensor) -> Tensor:
    return tensor.local if isinstance(tensor, CardTensor) else tensor
