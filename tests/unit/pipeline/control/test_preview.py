"""The child process of previews: whatever it does, the request gets an answer, and the next one gets a new child."""

from __future__ import annotations

import json
import struct
import sys
from pathlib import Path

import pytest

from tests.world.drawn import DrawnWorld, spec
from tests.world.world import settings_of
from valerie.errors import MissingDependency, RenderingError, TransientError
from valerie.pipeline.control.preview import Previews
from valerie.runs.resolving.spec import parse

#: Reads a job.
READ = "import struct, sys, time; sys.stdin.buffer.read(struct.unpack('<I', sys.stdin.buffer.read(4))[0]);"


def previews(tmp_path: Path, program: str, *, seconds: float = 60.0) -> Previews:
    world = DrawnWorld(settings_of(tmp_path))
    return Previews(world.context, command=[sys.executable, "-c", program], seconds=seconds)


def answering(document: dict[str, object]) -> str:
    data = json.dumps(document).encode()
    return (
        f"{READ} sys.stdout.buffer.write({struct.pack('<I', len(data)) + data!r}); sys.stdout.flush(); time.sleep(600)"
    )


def test_a_child_that_hangs_is_ended(tmp_path: Path) -> None:
    hanging = previews(tmp_path, f"{READ} time.sleep(600)", seconds=1.0)
    with pytest.raises(TransientError, match="longer than 1 s"):
        hanging.render(parse(spec("n")), [0])


@pytest.mark.parametrize("program", ["raise SystemExit(1)", f"{READ} raise SystemExit(1)", answering({"odd": 1})])
def test_a_child_that_ends_or_talks_nonsense_is_replaced(tmp_path: Path, program: str) -> None:
    ending = previews(tmp_path, program)
    for _ in range(2):
        with pytest.raises(TransientError, match="ended"):
            ending.render(parse(spec("n")), [0])


def test_a_machine_without_an_engine_refuses_politely(tmp_path: Path) -> None:
    missing = previews(tmp_path, answering({"error": "moderngl is not installed", "engine_missing": True}))
    with pytest.raises(MissingDependency, match="cannot render previews: moderngl"):
        missing.render(parse(spec("n")), [0])
    missing.close()


def test_the_engine_s_refusal_is_passed_on(tmp_path: Path) -> None:
    refusing = previews(tmp_path, answering({"error": "the image is constant"}))
    with pytest.raises(RenderingError, match="the image is constant"):
        refusing.render(parse(spec("n")), [0])
    refusing.close()


def test_no_child_is_started_for_rejected_variants(tmp_path: Path) -> None:
    never = previews(tmp_path, "raise SystemExit(1)")
    document = spec("n")
    rejected = 23
    (answer,) = never.render(parse(document), [rejected])
    assert answer.picture is None
    assert answer.variant.rejection
