"""Large packages are imported without collections of garbage, which then go on."""

import gc
import sys

import pytest
from dgs.core.imports import large_imports


@pytest.fixture(autouse=True)
def unfrozen():
    """Whatever a test leaves, the next one finds as ever."""
    yield
    gc.unfreeze()
    gc.enable()


def test_no_garbage_is_looked_for_while_a_large_package_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    gc.unfreeze()
    with large_imports():
        assert not gc.isenabled()
        with large_imports():
            assert not gc.isenabled()
        assert not gc.isenabled(), "the outer one goes on"
    assert gc.isenabled() and gc.get_freeze_count() > 0


def test_collections_go_on_where_the_import_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    with pytest.raises(ImportError), large_imports():
        raise ImportError
    assert gc.isenabled()


def test_where_it_has_come_nothing_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands that are run one after the other in a process leave garbage of their own."""
    monkeypatch.setitem(sys.modules, "torch", gc)
    gc.unfreeze()
    with large_imports():
        assert gc.isenabled()
    assert gc.get_freeze_count() == 0
