"""Frames one behind the other: no copy where they lie so already, the same values everywhere."""

import torch
from dgs.core.frames import in_a_row


def test_parts_of_one_tensor_are_not_copied():
    whole = torch.rand(4, 3, 5, 6)
    for parts in (list(whole), list(whole[1:3])):
        found = in_a_row(parts)
        assert torch.equal(found, torch.stack(parts)) and found.data_ptr() == parts[0].data_ptr()


def test_all_else_is_copied():
    whole, other = torch.rand(4, 3, 5, 6), torch.rand(3, 5, 6)
    for parts in (
        [whole[0], whole[2]],
        [whole[1], whole[0]],
        [whole[0], other],
        [whole[0].transpose(1, 2), whole[1].transpose(1, 2)],
        [whole[0, :, 1:], whole[1, :, 1:]],
        [whole[0], whole[0]],
    ):
        found = in_a_row(parts)
        assert torch.equal(found, torch.stack(parts))
        assert found.untyped_storage().data_ptr() != whole.untyped_storage().data_ptr()
