"""Several processes that train one twin: who they are, and what they say to each other.

torch.distributed's gloo carries it, started as everybody starts it (`torchrun`, or `srun` with it): RANK, WORLD_SIZE,
MASTER_ADDR and MASTER_PORT are in the environment. Alone, nothing is loaded and nothing is said.

Every rank holds the same Gaussians and takes the same steps; each renders its own photos. Sums are the same bits on all
of them: gloo adds in an order that only the number of ranks decides.
"""

from __future__ import annotations

import json
import os
import re
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..errors import TrainingError
from ..numbers import number

T = TypeVar("T")


@dataclass(frozen=True)
class RankSettings:
    """Numbers of what ranks say to each other."""

    patience: float = number(
        1800.0, "s", "that a rank waits for another one: reading a large set takes one longer than the other"
    )


SETTINGS = RankSettings()


class RankLost(TrainingError):
    """Another rank died, or does not answer."""


class RanksDiffer(TrainingError):
    """A rank trains something else."""


class OtherRankFinishes(Exception):
    """The training is over, and rank 0 does the rest: no error."""


@dataclass
class Ranks:
    """This process among those that train together.

    Attributes:
        rank, count: of [0, count); rank 0 has the folder, and speaks.
        sent: bytes that this rank gave to others or took from them in steps; a sum over all ranks costs each of them
            2 (count - 1) / count times its size, either way.
    """

    rank: int = 0
    count: int = 1
    sent: int = field(default=0, compare=False)

    @property
    def alone(self) -> bool:
        """Whether there is no other."""
        return self.count == 1

    def add(self, tensors: Sequence[Tensor]) -> None:
        """Replaces float32 tensors by their sums over all ranks; raises RankLost."""
        flat = torch.cat([tensor.reshape(-1) for tensor in tensors])
        _said(lambda: torch.distributed.all_reduce(flat))
        self.sent += 2 * (self.count - 1) * flat.numel() * flat.element_size() // self.count
        for tensor, total in zip(tensors, flat.split([tensor.numel() for tensor in tensors]), strict=True):
            tensor.copy_(total.view_as(tensor))

    def any(self, flag: bool) -> bool:
        """Whether any rank says so; raises RankLost."""
        if self.alone:
            return flag
        said = torch.tensor([int(flag)])
        _said(lambda: torch.distributed.all_reduce(said))
        return bool(said.item())

    def each(self, facts: Any) -> list[Any]:
        """What every rank says, by rank: anything that JSON holds; raises RankLost."""
        data = np.frombuffer(json.dumps(facts).encode(), np.uint8)
        lengths = [torch.zeros(1, dtype=torch.int64) for _ in range(self.count)]
        _said(lambda: torch.distributed.all_gather(lengths, torch.tensor([len(data)])))
        longest = max(int(length) for length in lengths)
        mine = torch.zeros(longest, dtype=torch.uint8)
        mine[: len(data)] = torch.from_numpy(data.copy())
        said = [torch.zeros_like(mine) for _ in range(self.count)]
        _said(lambda: torch.distributed.all_gather(said, mine))
        return [json.loads(one[: int(length)].numpy().tobytes()) for one, length in zip(said, lengths, strict=True)]

    def bytes_of_first(self, data: bytes | None) -> bytes | None:
        """What rank 0 has, on all ranks; None where it has nothing. Raises RankLost."""
        if self.alone:
            return data
        length = torch.tensor([-1 if data is None else len(data)])
        _said(lambda: torch.distributed.broadcast(length, 0))
        if int(length) < 0:
            return None
        own = data if self.rank == 0 and data is not None else bytes(int(length))
        content = torch.frombuffer(bytearray(own), dtype=torch.uint8) if own else torch.zeros(0, dtype=torch.uint8)
        _said(lambda: torch.distributed.broadcast(content, 0))
        return content.numpy().tobytes()

    def arrays_of_first(self, arrays: Mapping[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
        """Rank 0's float32 arrays, on all ranks; raises RankLost."""
        if self.alone:
            return dict(arrays)
        shapes = self.bytes_of_first(json.dumps({name: array.shape for name, array in arrays.items()}).encode())
        assert shapes is not None
        wanted: dict[str, list[int]] = json.loads(shapes)
        sizes = [int(np.prod(shape)) for shape in wanted.values()]
        flat = torch.zeros(sum(sizes))
        if self.rank == 0:
            flat = torch.from_numpy(np.concatenate([np.ravel(arrays[name]) for name in wanted]).astype(np.float32))
        _said(lambda: torch.distributed.broadcast(flat, 0))
        parts = flat.split(sizes)
        return {name: part.numpy().reshape(shape) for (name, shape), part in zip(wanted.items(), parts, strict=True)}

    def agree(self, facts: Mapping[str, Any], differs: Callable[[Any, Any], str | None]) -> None:
        """Makes sure that all ranks train the same.

        Args:
            facts: what must be the same, as JSON holds it.
            differs: of rank 0's facts and another's, in words; None where they are the same.

        Raises:
            RanksDiffer: it names the first rank that has something else, on all ranks alike. RankLost.
        """
        if self.alone:
            return
        said = self.each({"host": socket.gethostname(), "facts": facts})
        for rank, one in enumerate(said):
            difference = differs(said[0]["facts"], one["facts"])
            if difference is not None:
                raise RanksDiffer(
                    f"Rank {rank} on '{one['host']}' {difference} (compared with rank 0 on '{said[0]['host']}')",
                    "Start all ranks with the same command, version and photos",
                )


#: Nobody else.
ALONE = Ranks()


def started_together() -> bool:
    """Whether this process is one of several that were started to train one twin."""
    count = os.environ.get("WORLD_SIZE", "1")
    return count.isdecimal() and int(count) > 1 and "MASTER_ADDR" in os.environ


def join_ranks() -> Ranks:
    """Meets the other ranks; raises RankLost where they do not come."""
    _said(
        lambda: torch.distributed.init_process_group(
            "gloo", init_method="env://", timeout=timedelta(seconds=SETTINGS.patience)
        )
    )
    return Ranks(torch.distributed.get_rank(), torch.distributed.get_world_size())


def leave_ranks() -> None:
    """Ends the connections, if there are any."""
    if torch.distributed.is_available() and torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


def local_count() -> int:
    """How many ranks share this machine."""
    count = os.environ.get("LOCAL_WORLD_SIZE", "1")
    return max(1, int(count)) if count.isdecimal() else 1


def _said(talk: Callable[[], T]) -> T:
    """Whatever gloo raises is one error here: somebody is not there any more."""
    try:
        return talk()
    except (RuntimeError, ValueError) as error:
        # (gloo begins with a place in its own source, and goes on with advice)
        reason = re.sub(r"^\[[^]]*\]\s*", "", str(error).strip()).split(". ")[0].splitlines() or [type(error).__name__]
        raise RankLost(
            f"Another rank died or does not answer ({reason[0][:120]})",
            "Start all ranks again with --resume; their number may be another",
        ) from error
