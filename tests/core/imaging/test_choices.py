"""Which evaluation is fastest is measured once, however many ask."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

from dgs.core.imaging import choices


def test_many_threads_that_ask_the_same_measure_once(tmp_path, monkeypatch):
    monkeypatch.setattr(choices, "cache_base", lambda: tmp_path)
    asked, at_once = [], threading.Barrier(6)

    def measure() -> str:
        asked.append(threading.current_thread().name)
        time.sleep(0.05)
        return "direct"

    def ask(_: int) -> str:
        at_once.wait(10.0)
        return choices.choice(b"kernel", "a test", names=["direct", "fourier"], measure=measure)

    with ThreadPoolExecutor(6) as pool:
        assert set(pool.map(ask, range(6))) == {"direct"}
    assert len(asked) == 1
