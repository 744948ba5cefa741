"""What `valerie run` says at its end."""

from __future__ import annotations

from pathlib import Path

from valerie.cli.runs import next_step

SPEC = "name: s\nasset: urban-street\nfunctions: [my-net]\n"


def test_the_next_step_repeats_the_command_with_the_functions_and_the_folder_it_was_given() -> None:
    text = next_step(Path("my spec.yaml"), SPEC.encode(), functions="my-net,other", data_dir=Path("/data here"))
    assert "run 'my spec.yaml' --functions my-net,other --data-dir '/data here'\n" in text
    plain = next_step(Path("s.yaml"), SPEC.encode(), functions=None, data_dir=None)
    assert "add the line  sensors: [{name: day}, {name: dusk, exposure_ev: -2}]  to s.yaml; then" in plain
    assert "run s.yaml\n" in plain


def test_a_spec_with_sensors_gets_one_more_and_not_a_second_list() -> None:
    text = next_step(Path("s.yaml"), f"{SPEC}sensors: [{{name: day}}]\n".encode(), functions=None, data_dir=None)
    assert "add  {name: dusk, exposure_ev: -2}  to the sensors in s.yaml; then" in text
