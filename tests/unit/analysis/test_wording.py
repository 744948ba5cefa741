from valerie.analysis.comparison.before_after import GroupDifference, VersionChange
from valerie.analysis.comparison.wording import change_sentence
from valerie.analysis.findings.findings import Finding, Findings, Inequality, Step
from valerie.analysis.findings.wording import finding_sentence, measured_note, searched_sentence
from valerie.analysis.wording import ALIKE_PLACES, setting_labels
from valerie.statistics.contrasts import Matching
from valerie.statistics.importance import Importance
from valerie.statistics.units import Estimand


def test_with_one_sensor_a_label_is_the_name_of_the_function() -> None:
    pairs = [("fpn", "default"), ("deeplab", "default"), ("fpn", "default")]
    assert list(setting_labels(pairs).items()) == [(("fpn", "default"), "fpn"), (("deeplab", "default"), "deeplab")]


def test_with_several_sensors_each_label_names_its_sensor() -> None:
    labels = setting_labels([("fpn", "day"), ("fpn", "dusk"), ("deeplab", "day")])
    assert list(labels.values()) == ["fpn · sensor day", "fpn · sensor dusk", "deeplab · sensor day"]


SUN = Step("sun-1.azimuth", "140°", "260°")
FAR = Step("person-1.pos.y", "5", "26")


def finding(
    effect: float, *steps: Step, low: float | None = None, high: float | None = None, **more: object
) -> Finding:
    """A finding of six places and 36 pairs."""
    known = {
        "function": "net",
        "matching": Matching.BLOCKS,
        "estimand": Estimand.LISTED_GRID,
        "confirmed": True,
        "places_needed": 50,
        **more,
    }
    return Finding(sentence="", steps=steps, effect=effect, low=low, high=high, places=6, pairs=36, **known)  # type: ignore[arg-type]


def test_a_finding_within_places_says_effect_condition_interval_and_numbers() -> None:
    assert finding_sentence(finding(-0.1234, SUN, low=-0.2, high=-0.05)) == (
        "net: pACC is 12.3 points lower with sun-1.azimuth 260° than with 140°, all else equal "
        "(joint 95 % interval −20.0 to −5.0 points for places like these on this site, 6 places, 36 pairs)."
    )


def test_a_finding_between_places_says_so_and_names_what_else_differs() -> None:
    unequal = (Inequality("occlusion_rate", FAR, 0.03, 0.5), Inequality("distance_m", FAR, 17.5, 38.2))
    assert finding_sentence(finding(-0.5, FAR, low=-0.7, high=-0.1, matching=Matching.MODEL, unequal=unequal)) == (
        "net: pACC is 50.0 points lower with person-1.pos.y 26 than with 5, between different places "
        "(joint 95 % interval −70.0 to −10.0 points for places like these on this site, 6 places, 36 pairs). The sides also "
        "differ in occlusion (50.0 % with person-1.pos.y 26, 3.0 % with 5) and "
        "distance (38.20 m with person-1.pos.y 26, 17.50 m with 5)."
    )


def test_an_effect_without_interval_says_how_many_places_would_show_its_size() -> None:
    assert finding_sentence(finding(-0.2, SUN, places_for_size=1234)).endswith(
        "(6 places, 36 pairs). They show that it is lower, not by how much (those that "
        "suggested it do not count); about 1,234 places would."
    )
    assert finding_sentence(finding(-0.2, SUN, places_for_size=1234, confirmed=False)).endswith(
        "(6 places, 36 pairs). They do not show its size; about 1,234 places would."
    )
    assert finding_sentence(finding(-0.2, SUN)).endswith("(6 places, 36 pairs).")


def test_a_candidate_that_only_the_search_saw_says_that_its_size_is_of_the_searched_places() -> None:
    candidate = finding(-0.2, SUN, confirmed=False, alike=True, searched=True)
    assert finding_sentence(candidate).endswith("(in the 6 places searched, 36 pairs).")


def test_an_interaction_is_an_effect_that_differs() -> None:
    camera = Step("camera", "camera-1", "camera-3")
    assert finding_sentence(finding(0.08, SUN, camera)).startswith(
        "net: the effect of sun-1.azimuth 260° instead of 140° on pACC is 8.0 points higher with camera-3 than with "
        "camera-1, all else equal"
    )


def test_of_two_functions_the_better_one_is_named_first() -> None:
    functions = Step("function", "deeplab", "fpn")
    assert finding_sentence(finding(-0.05, functions, function="", low=-0.08, high=-0.02)) == (
        "deeplab sees more than fpn on identical frames: pACC is 5.0 points higher "
        "(joint 95 % interval 2.0 to 8.0 points for places like these on this site, 6 places, 36 pairs)."
    )


def test_a_run_without_findings_says_how_much_was_looked_at() -> None:
    def said(comparisons: int, confirming: int) -> str:
        return searched_sentence(Findings((), (), comparisons, 0.95, 6, confirming))

    assert said(0, 0).startswith("Nothing to compare")
    assert said(12, 0) == "12 comparisons searched in 6 places, too few to confirm anything: 10 places are needed."
    assert said(12, 6).endswith("judged in 6 others with 95 % confidence for all together; none is confirmed.")


def test_why_no_measured_quantity_is_named_is_said() -> None:
    assert "too few places" in measured_note([])
    assert ALIKE_PLACES in measured_note([Importance("distance_m", 0.1, 0.001, alike=True)])
    assert measured_note([Importance("distance_m", 0.1, 0.5)]) == ""


def test_a_change_between_versions_has_its_interval_and_its_flips() -> None:
    own = GroupDifference(0.048, 0.01, 0.09, 20, 2, 7, "better", Estimand.DESIGN_BOX, 20)
    assert change_sentence(VersionChange("group", "far", 0.5, 0.55, 0.048, own)) == (
        "far: mean pACC 50.0 → 55.0 % (+4.8 points by place, 95 % [+1.0, +9.0] for the space that the design "
        "draws from, 20 places; 2 lost, 7 gained)"
    )
