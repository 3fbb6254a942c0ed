"""What `--rolling-shutter` takes."""

import pytest
from dgs.core.errors import DgsError
from dgs.core.shutter import ShutterRequest, parse_shutter


def test_what_is_written_is_what_is_read():
    assert parse_shutter("auto") == ShutterRequest() and parse_shutter("-0.5") == ShutterRequest(-0.5)


@pytest.mark.parametrize("text", ["", "fast", "nan", "inf", "21", "1,2"])
def test_what_makes_no_sense_is_said_in_a_line(text):
    with pytest.raises(DgsError, match="auto, or the exposures"):
        parse_shutter(text)
