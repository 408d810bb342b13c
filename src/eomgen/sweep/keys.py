"""The keys of a sweep's plan: what each takes, its unit, and a line about it."""

from __future__ import annotations

from ..forms.keys import Choice, Flag, Key, Listed, Number, Strings, Text, Whole
from ..forms.tables import Entries, Form, Sub

DESIGNS = ("random", "latin_hypercube")
ENGINES = ("auto", "rollout", "integrate")
RECORDS = (
    *("tool_deviation_max", "tool_deviation_rms", "tool_deviation_end", "tool_rotation_max"),
    *("drive_max", "drive_rms", "tracking_max", "deviation_max", "reaction_max"),
    *("coordinate_max", "coordinate_end", "state_max", "state_end", "quaternion_end", "energy_residue"),
)
DEFAULT_RECORD = ("tool_deviation_max", "tool_deviation_rms", "tool_deviation_end", "drive_max", "deviation_max")
MOST_SAMPLES = 10**8

DISTRIBUTIONS: dict[str, Key] = {
    "grid": Sub(
        "every one of some values; of several grids every combination",
        inner=Form(
            {
                "values": Listed("the values", item=Number(""), fewest=1, rule="an array of one or more numbers"),
                "low": Number("the first of evenly spaced values, with high and count"),
                "high": Number("the last of them"),
                "count": Whole("how many they are", least=2, most=10**6),
            }
        ),
    ),
    "uniform": Sub(
        "every number between two bounds alike",
        inner=Form(
            {
                "low": Number("least", needed="a finite number"),
                "high": Number("greatest, more than low", needed="a finite number"),
            }
        ),
    ),
    "normal": Sub(
        "normally distributed",
        inner=Form(
            {
                "mean": Number("of the distribution", needed="a finite number"),
                "deviation": Number("its standard deviation", needed="a finite number", above=0.0),
                "low": Number("cut off below"),
                "high": Number("cut off above"),
            }
        ),
    ),
}
VARY = Form(
    {
        "parameter": Text("a number of the description, by its parameter's name; or scenario"),
        "scenario": Text("path of a number in the scenario, such as control.bandwidth; or parameter"),
        "relative": Flag("true: numbers are multiples of what robot and scenario say"),
        **DISTRIBUTIONS,
    }
)
ENGINE = Form({"type": Choice("how samples are integrated; default auto", words=ENGINES)})
FORMER = ("method", "step", "period")  # keys of ENGINE that are refused with what took their place
PLAN = Form(
    {
        "samples": Whole("draws of what is random", least=1, most=MOST_SAMPLES),
        "seed": Whole("of the draws; default 0"),
        "design": Choice("of the draws; default random", words=DESIGNS),
        "record": Strings(
            "what is written of each sample",
            words=RECORDS,
            some=True,
            rule=f"one or more different names of {', '.join(RECORDS)}",
        ),
        "engine": Sub("how samples are integrated", inner=ENGINE),
        "vary": Entries("what changes from sample to sample", "", "one or more tables [[vary]]", inner=VARY, fewest=1),
    }
)
