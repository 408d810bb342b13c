"""JSON Schemas of the file formats: current, valid, no stricter than the readers; what they cannot say is listed."""

from __future__ import annotations

import json
import re
import tomllib
import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from eomgen.authoring.schema_files import schema_path
from eomgen.authoring.schemas import FORMATS, schema_of, schema_text
from eomgen.description.load import robot_from_toml
from eomgen.errors import EomgenWarning, InputError
from eomgen.forms.keys import Keys
from eomgen.forms.structure import faults
from eomgen.forms.tables import DEGREES, Form, Kinds
from eomgen.robot.value import COORDINATES
from eomgen.scenario.load import scenario_from_toml
from eomgen.sweep.plan import plan_from_toml
from tests.support.bad_files import DURATION, LINE, PLANS, ROBOTS, SCENARIOS, Bad
from tests.support.description_samples import ARM
from tests.support.good_files import DOCUMENTS
from tests.support.mutations import KEYS, Chance, any_table, any_value, as_document, as_toml, mutant

ROOT = Path(__file__).parents[2]
READERS = {"robot": robot_from_toml, "scenario": scenario_from_toml, "plan": plan_from_toml}
VALIDATORS = {name: jsonschema.Draft7Validator(schema_of(name)) for name in FORMATS}
MUTANTS = {"toml": "robot", "scenario": "scenario", "plan": "plan"}  # what tests/support/mutations.py calls them


def refused(name: str, values: Any) -> bool:
    """Whether the schema refuses the values."""
    try:
        return not VALIDATORS[name].is_valid(values)
    except ValueError:  # it cannot print an integer of thousands of digits that is too large
        return True


def parsed(text: str) -> dict[str, Any] | None:
    try:
        values: dict[str, Any] = tomllib.loads(text)
    except (ValueError, RecursionError):
        return None
    return values


def is_read(name: str, text: str) -> bool:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", EomgenWarning)
        try:
            READERS[name](text)
        except InputError:
            return False
    return True


def check_soundness(name: str, text: str) -> bool:
    """What the schema refuses the reader refuses, and ``eomgen check`` finds by the structure alone."""
    values = parsed(text)
    if values is None:
        return False
    found = faults(FORMATS[name][0], values, "")
    if found or refused(name, values):
        assert found, f"the schema refuses what the structure allows: {text}"
        assert not is_read(name, text), f"{found or ''} is refused by the schema, and read: {text}"
    return refused(name, values)


@pytest.mark.parametrize("name", FORMATS)
def test_files_are_current(name: str) -> None:
    assert schema_path(name).read_text(encoding="ascii") == schema_text(name), "make schemas writes the new one"


@pytest.mark.parametrize("name", FORMATS)
def test_schemas_are_schemas(name: str) -> None:
    jsonschema.Draft7Validator.check_schema(schema_of(name))


def expanded(schema: Any, definitions: dict[str, Any], used: list[str]) -> Any:
    """A part of a schema with definitions in the places of references, whose names are added to ``used``."""
    if isinstance(schema, list):
        return [expanded(item, definitions, used) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        (reference,) = schema.values()  # editors ignore what stands beside it
        used.append(reference.removeprefix("#/definitions/"))
        return expanded(definitions[used[-1]], definitions, used)
    return {key: expanded(value, definitions, used) for key, value in schema.items() if key != "definitions"}


@pytest.mark.parametrize("name", FORMATS)
def test_definitions_are_those_of_keys_that_stand_in_several_tables(name: str) -> None:
    """Each is used at least twice, and with all of them in their places the schema is that of the forms."""
    schema, used = schema_of(name), list[str]()
    definitions = schema.get("definitions", {})
    whole = expanded(schema, definitions, used)
    assert Counter(used).keys() == definitions.keys()
    assert min(Counter(used).values(), default=2) >= 2
    if name != "robot":  # whose keys a URDF may have
        assert whole == {"$schema": schema["$schema"], "title": schema["title"], **FORMATS[name][0].json()}
    assert whole["properties"] == FORMATS[name][0].json()["properties"]
    assert (len(json.dumps(schema)) < 0.5 * len(json.dumps(whole))) == (name == "robot")


def properties(schema: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(schema, list):
        for item in schema:
            yield from properties(item)
    elif isinstance(schema, dict):
        if schema.get("additionalProperties") is False:  # those of an anyOf only say what is needed
            yield from schema["properties"].items()
        for value in schema.values():
            yield from properties(value)


@pytest.mark.parametrize("name", FORMATS)
def test_every_property_is_described(name: str) -> None:
    schema = schema_of(name)
    found = list(properties(expanded(schema, schema.get("definitions", {}), [])))
    assert len(found) > 20
    for key, schema in found:
        assert len(schema["description"]) > 3, key
    with_units = [key for key, schema in found if re.search(r" \[.*\]$", schema["description"])]
    assert name == "plan" or {"mass", "inertia"} <= set(with_units)
    if name == "robot":
        bare = {key for key, schema in found if schema.get("type") == "number"} - set(with_units)
        assert not bare, "numbers without a unit"


@pytest.mark.parametrize(
    ("name", "path"),
    [
        *(("robot", path) for path in sorted(ROOT.glob("src/eomgen/robots/*.toml"))),
        *(("scenario", path) for path in sorted(ROOT.glob("src/eomgen/scenarios/*.toml"))),
        ("robot", ROOT / "src/eomgen/new_files/robot.toml"),
        ("scenario", ROOT / "src/eomgen/new_files/scenario.toml"),
        *(
            ("plan" if "vary" in text else "scenario" if "\nduration" in text else "robot", path)
            for path in sorted(ROOT.glob("examples/*.toml"))
            for text in [path.read_text(encoding="utf-8")]
        ),
    ],
    ids=lambda value: value.stem if isinstance(value, Path) else value,
)
def test_what_is_shipped_is_valid(name: str, path: Path) -> None:
    VALIDATORS[name].validate(tomllib.loads(path.read_text(encoding="utf-8")))


def test_samples_are_valid() -> None:
    for kind, name in MUTANTS.items():
        for document in DOCUMENTS[kind]:
            VALIDATORS[name].validate(document)
    VALIDATORS["robot"].validate({"urdf": "arm.urdf", "joints": [{"name": "elbow", "x": {}}]})
    assert refused("robot", {"urdf": "arm.urdf", "joints": [{"x": {}}]})
    assert refused("robot", {"name": "arm", "joints": [{"name": "elbow", "x": {}}]})
    assert refused("robot", {"links": []})


@pytest.mark.parametrize("case", [*ROBOTS, *SCENARIOS, *PLANS], ids=lambda case: case.title)
def test_bad_files(case: Bad) -> None:
    """Structural mistakes are refused; the others are those that are marked, and no more."""
    values = parsed(case.data.decode())
    if values is not None:
        assert refused(case.name.removesuffix(".toml"), values) != case.is_valid


def test_all_faults_of_a_table_that_may_be_a_word_are_found() -> None:
    turned = "orientation = { from = [1, 'x', 0], to_deg = [1, 0], until = 3 }"
    found = faults(FORMATS["scenario"][0], tomllib.loads(DURATION + LINE + turned), "")
    places = [error.where.removeprefix("motion.orientation") for error in found]
    assert places == ["", ".from.1", ".to_deg"]
    assert "unknown key 'until'" in str(found[0])
    (found_one,) = faults(FORMATS["scenario"][0], tomllib.loads(DURATION + LINE + "orientation = 3"), "")
    assert "'keep', or a table with from and to" in str(found_one)


def soundness_of_mutants(first: int, count: int) -> dict[str, int]:
    """How many mutants the schema refuses, by kinds."""
    found = dict.fromkeys(MUTANTS, 0)
    for kind, name in MUTANTS.items():
        for seed in range(first, first + count):
            found[kind] += check_soundness(name, mutant(kind, seed).decode("utf-8", "replace"))
    return found


def test_what_the_schema_refuses_the_reader_refuses() -> None:
    assert min(soundness_of_mutants(50_000_000, 300).values()) > 60


@pytest.mark.soak
def test_what_the_schema_refuses_the_reader_refuses_many() -> None:
    found = soundness_of_mutants(51_000_000, 6000)
    print(f"\nof 6000 mutants of each kind the schema refuses {found}; so do the readers")


def test_any_table_that_the_schema_refuses_the_reader_refuses() -> None:
    for seed in range(40):
        top = any_table(Chance(f"table {seed}"))
        check_soundness("robot", as_document(top))
        check_soundness("robot", as_document({"name": "arm", **top}))


def test_any_value_that_the_schema_refuses_the_reader_refuses() -> None:
    for seed in range(100):
        chance = Chance(f"value {seed}")
        table = f"[[{chance.choice(('links', 'joints', 'frames'))}]]\n"
        entry = f"{as_toml(chance.choice(KEYS))} = {as_toml(any_value(chance))}\n"
        check_soundness("robot", ARM.replace(table, table + entry, 1))


def forms_of(form: Form | Kinds) -> Iterator[Keys]:
    """Keys of a form and of all that are inside."""
    for keys in [form.keys] if isinstance(form, Form) else form.kinds.values():
        yield keys
        kinds = list(keys.values())
        for kind in kinds:
            kinds += getattr(kind, "options", ())
            if isinstance(getattr(kind, "inner", None), (Form, Kinds)):
                yield from forms_of(kind.inner)


@pytest.mark.parametrize("name", FORMATS)
def test_angles_have_a_key_for_degrees(name: str) -> None:
    """All but coordinates of joints, whose units their names say; the two take the same."""
    angles = 0
    for keys in forms_of(FORMATS[name][0]):
        for key, kind in keys.items():
            if kind.unit != "rad" or (key in COORDINATES and "x" in keys):
                continue
            angles += 1
            degrees = keys[key + DEGREES]
            assert (degrees.unit, degrees.needed) == ("deg", "")
            assert degrees.json() == kind.json()
        for key in keys:
            assert not key.endswith(DEGREES) or keys[key.removesuffix(DEGREES)].unit == "rad"
    assert bool(angles) == (name != "plan")
