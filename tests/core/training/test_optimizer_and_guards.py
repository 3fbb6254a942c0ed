"""Adam, what becomes of non-finite numbers, and adaptive density control."""

import math

import numpy as np
import pytest
import torch
from dgs.core.errors import NonFiniteParameter
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import ScreenStatistics
from dgs.core.training.density.control import DENSITY, DensityControl
from dgs.core.training.guards import GUARDS, drop_non_finite, limit_sizes
from dgs.core.training.optimizer import Adam
from dgs.tests.core.training.training_scenes import same

RATES = {"means": 1e-3, "log_scales": 2e-2, "quaternions": 3e-3, "opacity_logits": 0.1, "sh": 1e-2, "sh_rest": 5e-4}


def some(count: int = 40, degree: int = 1, seed: int = 0) -> Gaussians:
    random = torch.Generator().manual_seed(seed)
    shapes = {
        "means": (count, 3),
        "log_scales": (count, 3),
        "quaternions": (count, 4),
        "opacity_logits": (count,),
        "sh": (count, (degree + 1) ** 2, 3),
    }
    return Gaussians(**{name: torch.randn(*shape, generator=random) for name, shape in shapes.items()})


def with_gradients(optimizer: Adam, seed: int) -> dict[str, torch.Tensor]:
    """Gives every parameter a random gradient of very different sizes."""
    random = torch.Generator().manual_seed(seed)
    out = {}
    for name, tensor in optimizer.gaussians.named():
        spread = 10 ** torch.empty(tensor.shape).uniform_(-8, 2, generator=random)
        out[name] = torch.randn(tensor.shape, generator=random) * spread
        tensor.grad = out[name].clone()
    return out


@pytest.mark.parametrize("degree", [0, 1, 3])
def test_adam_agrees_with_torch(degree):
    start = some(degree=degree)
    ours = Adam(start)
    leaves = {name: t.clone().double().requires_grad_() for name, t in start.named() if name != "sh"}
    base = start.sh[:, :1].clone().double().requires_grad_()
    rest = start.sh[:, 1:].clone().double().requires_grad_()
    groups = [{"params": [t], "lr": RATES[name]} for name, t in leaves.items()]
    groups += [{"params": [base], "lr": RATES["sh"]}, {"params": [rest], "lr": RATES["sh_rest"]}]
    theirs = torch.optim.Adam(groups, betas=(0.9, 0.999), eps=1e-15)
    for step in range(25):
        gradients = with_gradients(ours, step)
        for name, leaf in leaves.items():
            leaf.grad = gradients[name].double()
        base.grad, rest.grad = gradients["sh"][:, :1].double(), gradients["sh"][:, 1:].double()
        ours.step(RATES)
        theirs.step()
    for name, leaf in leaves.items():
        torch.testing.assert_close(getattr(ours.gaussians, name).detach().double(), leaf.detach(), rtol=1e-4, atol=3e-5)
    both = torch.cat([base, rest], dim=1).detach()
    torch.testing.assert_close(ours.gaussians.sh.detach().double(), both, rtol=1e-4, atol=3e-5)


def test_gradients_are_forgotten_after_a_step():
    optimizer = Adam(some())
    with_gradients(optimizer, 0)
    optimizer.step(RATES)
    assert all(t.grad is None for _, t in optimizer.gaussians.named())
    before = optimizer.gaussians.detached()
    optimizer.step(RATES)
    assert same(before, optimizer.gaussians.detached())


@pytest.mark.parametrize("poison", [math.nan, math.inf, -math.inf])
def test_non_finite_gradients_are_refused_and_counted(poison):
    clean, spoiled = Adam(some()), Adam(some())
    with_gradients(clean, 1)
    with_gradients(spoiled, 1)
    for optimizer, value in ((clean, 0.0), (spoiled, poison)):
        assert optimizer.gaussians.means.grad is not None and optimizer.gaussians.sh.grad is not None
        optimizer.gaussians.means.grad[3, 1] = value
        optimizer.gaussians.sh.grad[7] = value
        optimizer.step(RATES)
    assert same(clean.gaussians.detached(), spoiled.gaussians.detached())
    assert spoiled.refused == {"means": 1, "sh": 12} and clean.refused == {}


@pytest.mark.parametrize("name", ["means", "log_scales", "quaternions", "opacity_logits", "sh"])
def test_non_finite_rows_are_dropped_and_counted(name):
    optimizer = Adam(some())
    with_gradients(optimizer, 0)
    optimizer.step(RATES)
    first = optimizer.first["means"].clone()
    kept = [row for row in range(40) if row not in (5, 11)]
    before = optimizer.gaussians.detached()
    with torch.no_grad():
        tensor = getattr(optimizer.gaussians, name)
        tensor.reshape(40, -1)[5, 0] = math.nan
        tensor.reshape(40, -1)[11, -1] = math.inf
    assert drop_non_finite(optimizer, 50) == {name: 2}
    expected = Gaussians(**{n: t[kept] for n, t in before.named()})
    assert same(optimizer.gaussians.detached(), expected)
    assert torch.equal(optimizer.first["means"], first[kept])
    assert drop_non_finite(optimizer, 100) == {}


def test_sizes_end_at_a_share_of_the_distance_to_the_nearest_camera():
    few = Gaussians(
        means=torch.tensor([[0.0, 0.0, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 400.0]]),
        log_scales=torch.log(torch.tensor([[9.0, 0.1, 0.02], [0.3, 0.2, 0.1], [60.0, 60.0, 1.0]])),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]] * 3),
        opacity_logits=torch.zeros(3),
        sh=torch.zeros(3, 1, 3),
    ).requires_grad_()
    before = few.detached()
    assert limit_sizes(few, torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])) == 1  # the nearest is 2 away
    assert few.log_scales[0].exp().tolist() == pytest.approx([2 * GUARDS.largest, 0.1, 0.02])
    assert torch.equal(few.log_scales[1:], before.log_scales[1:])
    assert torch.equal(few.means, before.means)


def test_all_rows_lost_is_an_error_that_names_the_parameter():
    optimizer = Adam(some())
    with torch.no_grad():
        optimizer.gaussians.log_scales[:] = math.nan
    with pytest.raises(NonFiniteParameter, match=r"step 150.*log_scales"):
        drop_non_finite(optimizer, 150)


def control(optimizer: Adam, lengths: torch.Tensor) -> DensityControl:
    count = len(optimizer.gaussians)
    density = DensityControl(count, torch.device("cpu"))
    gradient = torch.stack([lengths, torch.zeros(count)], dim=1)
    density.collect(ScreenStatistics(radius=torch.ones(count), mean_gradient=gradient))
    return density


def test_density_grows_where_gradients_are_large_and_moments_follow():
    optimizer = Adam(some(100))
    with torch.no_grad():
        optimizer.gaussians.opacity_logits[:] = 1.0
        optimizer.gaussians.opacity_logits[:7] = math.log(0.5 * DENSITY.minimum_opacity)  # invisible
    with_gradients(optimizer, 0)
    optimizer.step({**RATES, "opacity_logits": 0.0})
    means = optimizer.gaussians.means.detach().clone()
    first, second = optimizer.first["means"], optimizer.second["means"]
    lengths = torch.zeros(100)
    lengths[50:60] = 1.0
    density = control(optimizer, lengths)
    density.act(optimizer, 1000, np.random.default_rng(0))
    counts = density.counts
    assert counts["pruned"] == 7 and counts["cloned"] + counts["split"] == 10
    g = optimizer.gaussians
    assert len(g) == 100 - 7 + 10 and len(density.gradients) == len(density.views) == len(g)
    untouched = torch.tensor([*range(7, 50), *range(60, 100)])
    for row in untouched.tolist():
        (at,) = torch.nonzero((g.means == means[row]).all(dim=1))[:, 0].tolist()
        assert torch.equal(optimizer.first["means"][at], first[row])
        assert torch.equal(optimizer.second["means"][at], second[row])
    fresh = counts["cloned"] + 2 * counts["split"]
    for name, tensor in g.named():
        assert tensor.requires_grad and tensor.is_leaf
        assert bool((optimizer.first[name][-fresh:] == 0).all())
        assert optimizer.first[name].shape == optimizer.second[name].shape == tensor.shape


@pytest.mark.parametrize("target", [10, 93, 95, 110, 10_000])
def test_density_control_keeps_the_budget(target):
    optimizer = Adam(some(100))
    with torch.no_grad():
        optimizer.gaussians.opacity_logits[:] = 1.0
    density = control(optimizer, torch.rand(100, generator=torch.Generator().manual_seed(0)))
    density.act(optimizer, target, np.random.default_rng(0))
    assert len(optimizer.gaussians) <= max(100, target)


def test_a_twin_that_fades_is_not_emptied():
    optimizer = Adam(some(100))
    with torch.no_grad():
        optimizer.gaussians.opacity_logits[:] = torch.linspace(-12, -9, 100)
    control(optimizer, torch.ones(100)).act(optimizer, 100, np.random.default_rng(0))
    assert 50 <= len(optimizer.gaussians) <= 100
