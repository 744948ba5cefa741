"""In processes of their own: a limit is for good, and one of them ends its process."""

import subprocess
import sys


def ran(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


def test_an_allocation_beyond_the_limit_fails_and_the_process_goes_on() -> None:
    done = ran(
        "from valerie.perception.running.limits import limit_memory\n"
        "limit_memory(300)\n"
        "try:\n"
        "    bytearray(400 << 20)\n"
        "except MemoryError:\n"
        "    print('refused', len(bytearray(20 << 20)) >> 20)\n"
    )
    assert done.stdout == "refused 20\n", done.stderr


def test_work_that_takes_too_long_ends_its_process_with_a_reason() -> None:
    done = ran(
        "import re, time\n"
        "from valerie.perception.running.limits import time_limit\n"
        "with time_limit(0.2, what='function f'):\n"
        "    time.sleep(30)\n"
    )
    assert done.returncode == 124
    assert done.stderr == "valerie: function f took longer than 0.2 s\n"


def test_work_that_is_done_in_time_is_not_disturbed() -> None:
    done = ran(
        "import time\n"
        "from valerie.perception.running.limits import limit_memory, time_limit\n"
        "limit_memory(0)\n"
        "for seconds in (0, 0.3):\n"
        "    with time_limit(seconds, what='f'):\n"
        "        pass\n"
        "time.sleep(0.5)\n"
        "print('alive')\n"
    )
    assert done.stdout == "alive\n", done.stderr


def test_the_reason_is_handed_over_where_standard_error_was_replaced_as_in_a_workers_process() -> None:
    done = ran(
        "import io, sys, time\n"
        "from valerie.perception.running.limits import time_limit\n"
        "sys.stderr = io.StringIO()\n"
        "with time_limit(0.2, what='f', before_end=lambda reason: print('kept:', reason, flush=True)):\n"
        "    time.sleep(30)\n"
    )
    assert (done.returncode, done.stdout) == (124, "kept: f took longer than 0.2 s\n")
    assert done.stderr == "valerie: f took longer than 0.2 s\n"
