"""Tables of a description with any keys and values, for Hypothesis."""

from __future__ import annotations

from hypothesis import strategies as st

KEYS = [
    "x",
    "curve",
    "friction",
    "model",
    "coulomb",
    "static",
    "stribeck",
    "viscous",
    "bristle_stiffness",
    "bristle_damping",
    "hysteresis",
    "beta",
    "share",
    "maxwell",
    "band_hz",
    "branches",
    "drive",
    "winding",
    "resistance",
    "controller",
    "kp",
    "lag",
    "fade",
    "hysteresis",
    "A",
    "beta",
    "n",
    "share",
    "maxwell",
    "loss_factor",
    "band_hz",
    "branches",
    "clearance",
    "stops",
    "name",
    "gravity",
    "urdf",
    "inertia",
    "tunable",
    "links",
    "joints",
    "frames",
    "loops",
    "springs",
    "bushings",
    "beams",
    "couplings",
    "driven",
    "home",
    "of",
    "to",
    "offset",
    "points",
    "tension_only",
    "free_length",
    "mass",
    "com",
    "parent",
    "child",
    "type",
    "dh",
    "placement",
    "x",
    "gamma",
    "limits",
    "lower",
    "upper",
    "velocity",
    "effort",
    "motor",
    "prescribed",
    "placements",
    "xyz",
    "rpy",
    "segments",
    "section",
    "shear",
    "E",
    "xx",
    "stiffness",
    "damping",
    "matrix",
    "at",
    "preload",
    "ratio",
    "loss_factor",
    "at_hz",
    "drive",
    "lag",
    "winding",
    "controller",
    "position",
    "velocity",
    "kp",
    "ki",
    "limit",
    "a",
]


SCALARS = st.one_of(
    st.none().map(lambda _: "base"),
    st.sampled_from(
        [
            *("arm", "link1", "joint1", "revolute", "fixed", "free", "project", "links.*.mass", "*", "a.urdf"),
            *("K.mtx", "lugre", "bouc_wen", ""),
        ]
    ),
    st.text(max_size=8),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.booleans(),
)


TABLES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.sampled_from(KEYS) | st.text(max_size=4), inner, max_size=6)
    ),
    max_leaves=25,
)


TOPS = st.dictionaries(st.sampled_from(KEYS), TABLES, max_size=6)


ENTRIES = (
    st.sampled_from(["links", "joints", "frames", "loops", "couplings", "springs", "bushings", "beams"]),
    st.sampled_from(KEYS),
    TABLES,
)
