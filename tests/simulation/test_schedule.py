"""Processes of the simulation's schedule."""

from __future__ import annotations

from tests.simulation.schedule import Process, Schedule


def test_a_process_killed_before_its_first_step_never_runs() -> None:
    schedule = Schedule(seed=1, after=lambda: None)
    process, steps = Process("worker"), list[str]()
    over = False

    def end() -> None:
        nonlocal over
        over = True

    def kill() -> None:
        schedule.spawn(process, lambda: steps.append("ran"))
        schedule.kill(process)

    schedule.at(1.0, kill)
    schedule.at(2.0, end)
    schedule.run(lambda: over)
    assert not steps


def test_a_process_that_has_not_run_when_the_schedule_ends_is_killed() -> None:
    schedule = Schedule(seed=1, after=lambda: None)
    process = Process("worker")
    over = False

    def end() -> None:
        nonlocal over
        schedule.spawn(process, lambda: None)
        over = True

    schedule.at(1.0, end)
    schedule.run(lambda: over)
    assert not process.alive
