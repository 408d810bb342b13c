"""Random changes of right files: of trees, elements, cells, arrays, columns and bytes, where it hurts.

A document is a tree: TOML or JSON values, or XML elements as [tag, attributes, children].
"""

from __future__ import annotations

import io
import json
import random
import re
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from tests.support.good_files import COORDINATES, DOCUMENTS

Chance = random.Random
ESC = "\x1b[31mred\x1b[0m\u202e\n"
PIECES = [
    *('"', "'", '"""', "'''", "\\", "\n", "\r", "\0", "#", "=", ".", ",", "[", "]", "[[", "]]", "{", "}", "<", ">"),
    *("/>", "&amp;", "&#0;", "&#x202e;", "&x;", "<!--", "-->", "<![CDATA[", "]]>", "<?x?>", "<!DOCTYPE a>", "\ufeff"),
    *("nan", "inf", "-inf", "1e999", "-0", "0x", "1_0", "1979-05-27", "true", "\N{SNOWMAN}", "\u202e", "\U0001f600"),
    *("[[links]]", "[joints]", "name = ", '<link name="a"/>', "</robot>", '<joint name="j" type="fixed">', "a.b.c = 1"),
]
NAMES = [
    *("base", "world", "link1", "link2", "joint1", "joint2", "j1", "j2", "a", "b", "l1", "upper", "lower", "ground"),
    *("elbow", "shoulder", "revolute", "prismatic", "continuous", "floating", "planar", "fixed", "free", "locked", "x"),
    *("gamma", "prescribed", "project", "warn", "error", "links.*.mass", "*", "*.*.*", "joints", "a.urdf", "m.csv", ""),
    *("base.x", "joints.*.offset.z", "*.*", "**", "joints.*o*o*o*o*o*o*o*o*o*o*o*o*o*o*p.*.x", "frames.tcp.x", "tcp"),
    *("..", "../../etc/passwd.csv", "\0.csv", "\n", "\x1b[31m", "\u202e", "int", "*/", "%s%n", "a" * 200),
    *("\U0001f600" * 90, "K.mtx", "lugre", "bouc_wen", "arm.npz", "tip", "root", "screw"),
]
NUMBERS = [0, -1, 1, 1e-320, 1e30, -1e30, 1e31, 1e308, 2**63, 2**70, -(2**2000), 0.1, 1e-12, 1e-9, 0.5, 3.14159265]
EMPTY = [[], {}, [[]], [{}], {"": 0}, [0, 0, 0], [[0, 1], [1, 2]]]
VALUES = [*NUMBERS, *NAMES, *EMPTY, True, False, float("nan"), float("inf")]
ATTRIBUTES = ["0", "1", "-1", "nan", "inf", "1e400", "0 0 1", "1 2", "0x1", "", " ", "9" * 400, "1e-300 0 0", *NAMES]
DECIMALS = ["0", "-0", "1e-320", "1e30", "-1e30", "1e-30", "3.14", "1.5707963267948966", "-2", "1e31"]
TAGS = [
    *("link", "joint", "inertial", "origin", "mass", "inertia", "axis", "limit", "dynamics", "mimic", "parent"),
    *("child", "robot", "visual", "x:macro", "{"),
]
MJCF_TAGS = [
    *("body", "joint", "freejoint", "geom", "site", "frame", "inertial", "default", "compiler", "option", "flag"),
    *("worldbody", "tendon", "spatial", "fixed", "equality", "connect", "weld", "include", "replicate", "actuator"),
    *("visual", "x:macro", "{"),
]
MJCF_NAMES = (
    *("name", "class", "childclass", "type", "pos", "quat", "euler", "zaxis", "axis", "fromto", "size", "mass", "ref"),
    *("joint1", "joint2", "polycoef", "body1", "body2", "anchor", "relpose", "site1", "site2"),
    *("stiffness", "range", "angle", "eulerseq", "inertiafromgeom", "balanceinertia", "boundmass", "springlength"),
)
MJCF_VALUES = (
    *("true", "false", "auto", "radian", "degree", "zyx", "slide", "hinge", "ball", "free", "box", "sphere", "mesh"),
    *("ellipsoid", "cylinder", "0 0 0", "1 0 0 0", "0 0 0 0 0 1", "1 2 3", "leg", "main", "world", "torso", "hook"),
)
ARRAY_NAMES = [
    *(*COORDINATES, "t", "q", "v", "a", "u", "coordinates", "meta", "joint1.x.acceleration", "a/b", "..", "\x1b[31m"),
    *("", "H00", "K", "Phi", "M", "Q", "D", "interface_Psi", "mode", "../K"),
]
CELLS = [
    *(*ATTRIBUTES, *ARRAY_NAMES, "1_0", "\N{ARABIC-INDIC DIGIT ONE}", '"', '""', '"1', "1,2", "#", " # 1", "\0"),
    *("infinity", "1\r2"),
]
DTYPES = ("f2", "f4", "g", "i8", "c16", "?", "S3", "U9", "M8[s]", ">f8")
HEADERS = ["(5,)", "(5, 1)", "(True,)", f"({10**15},)", "(-1,)", "()", "(5", "'<f8'", "'|O'", "[('a', '<f8')]", "{"]
LARGE = (1e30, 9e29, 1e31, 1e60, 1e150, 1e160, 1e200, 1e300, 1.7e308, np.inf, np.nan)
SMALL = (1e-30, 1e-31, 1e-150, 1e-200, 1e-300, 5e-324, 0.0)


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every container of a tree with every key in it."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        yield node, key
        if isinstance(value, (dict, list)):
            yield from places(value)


_TREES = [tree for kind in ("toml", "scenario", "plan", "tolerances") for tree in DOCUMENTS[kind]]
KEYS = sorted({key for _, key in places(_TREES) if isinstance(key, str)})
KEYS += ["stops", "urdf", "bushings", "modes", "at", "stifness", "", "a b", "\n", "__class__"]


def any_value(chance: Chance, depth: int = 3) -> Any:
    """Return any value of TOML or JSON: words and numbers that hurt, any text or number, lists and tables of them."""
    kind = chance.random()
    if depth and kind < 0.1:
        return [any_value(chance, depth - 1) for _ in range(chance.randrange(5))]
    if depth and kind < 0.2:
        return any_table(chance, depth - 1)
    if kind < 0.25:
        return "".join(chr(chance.randrange(1 << chance.choice((7, 8, 16)))) for _ in range(chance.randrange(9)))
    if kind < 0.3:
        return chance.choice((chance.randrange(-(2**70), 2**70), float(np.frombuffer(chance.randbytes(8))[0])))
    return deepcopy(chance.choice(VALUES))


def any_table(chance: Chance, depth: int = 3) -> dict[str, Any]:
    """Return a table of any values, most of them with known keys."""
    return {chance.choice(KEYS): any_value(chance, depth) for _ in range(chance.randrange(7))}


def change_value(tree: dict[str, Any], chance: Chance) -> None:
    """Change a tree of values in one place."""
    found = list(places(tree))
    if not found:
        tree[chance.choice(KEYS)] = any_value(chance)
        return
    node, key = chance.choice(found)
    kind = chance.random()
    if kind < 0.35:
        node[key] = any_value(chance)
    elif kind < 0.5 and isinstance(node[key], (int, float)) and abs(node[key]) < 1e300:
        node[key] = chance.choice((-1, 2, 1e12, 1e-12)) * node[key]
    elif kind < 0.6:
        del node[key]
    elif kind < 0.7:
        other, place = chance.choice(found)
        node[key] = deepcopy(other[place])
    elif kind < 0.8 and isinstance(node, list):
        node.insert(key, deepcopy(node[key]))
    elif kind < 0.9 and isinstance(node, dict):
        node[chance.choice(KEYS)] = chance.choice((any_value(chance), deepcopy(node[key])))
    elif kind < 0.93 and isinstance(node, dict):
        node[chance.choice(KEYS)] = node.pop(key)
    else:
        node[key] = chance.choice((lambda x: [x], lambda x: {"x": x}, lambda x: [x] * 70, str))(node[key])


def elements(tree: list[Any]) -> Iterator[list[Any]]:
    """Yield an element and all inside of it."""
    yield tree
    for child in tree[2]:
        yield from elements(child)


def change_element(tree: list[Any], chance: Chance) -> None:
    """Change a tree of elements in one place, or all of its numbers."""
    found, mjcf = list(elements(tree)), tree[0] == "mujoco"
    values, tags = ((*ATTRIBUTES, *MJCF_VALUES), MJCF_TAGS) if mjcf else (ATTRIBUTES, TAGS)
    names = MJCF_NAMES if mjcf else ("name", "type", "link", "xyz", "rpy", "value", "lower", "xmlns", "x:y")
    tag, attributes, children = node = chance.choice(found)
    kind = chance.random()
    if kind < 0.03:
        for _, numbers, _ in found:
            for key, text in numbers.items():
                numbers[key] = re.sub(r"(?<!\S)-?[0-9.]+(?!\S)", lambda _: chance.choice(DECIMALS), text)
    elif kind < 0.5 and attributes:
        name = chance.choice(list(attributes))
        attributes[name] = chance.choice((*values, attributes[name] + " 1", "-" + attributes[name]))
    elif kind < 0.6 and attributes:
        del attributes[chance.choice(list(attributes))]
    elif kind < 0.7 and children:
        children.pop(chance.randrange(len(children)))
    elif kind < 0.8:
        children.insert(0, deepcopy(chance.choice(found)))
    elif kind < 0.85:
        node[0] = chance.choice([*tags, tag])
    elif kind < 0.9:
        attributes[chance.choice(names)] = chance.choice(MJCF_VALUES) if mjcf else "1 0 0"
    elif kind < 0.95:
        chance.shuffle(children)
    else:
        other = chance.choice(found)
        node[1], other[1] = other[1], node[1]


def change_cells(rows: list[list[str]], chance: Chance) -> None:
    """Change a table of cells in one place."""
    row = chance.choice(rows[chance.choice((0, 1)) :])
    at, kind = chance.randrange(len(row) + 1), chance.random()
    if kind < 0.6:
        row[at : at + 1] = [chance.choice(CELLS)]
    elif kind < 0.7:
        row.insert(at, chance.choice(CELLS))
    elif kind < 0.8:
        rows.insert(chance.randrange(len(rows) + 1), [chance.choice(["", "# a", " ", *CELLS, *PIECES])])
    elif kind < 0.9:
        rows.append(list(row))
    else:
        del row[at:]


def array_mutants(array: Any) -> Iterator[tuple[str, Any]]:
    """Yield an array with other shapes, types and values, each with what it is called."""
    array = np.asarray(array)
    row = np.atleast_1d(array)
    yield from (("transposed", array.T.copy()), ("longer", np.concatenate([row, row])), ("shorter", row[:-1]))
    yield from (
        ("empty", row[:0]),
        ("flat", array.reshape(-1)),
        ("deeper", array[np.newaxis]),
        ("number", np.array(1.0)),
    )
    yield from (("texts", np.full(array.shape, ESC)), ("backwards", row[::-1].copy()), ("deep", np.ones((1,) * 20)))
    yield from (("long", np.full(array.shape, np.finfo("g").max)), ("unsigned", np.full(array.shape, 2**63, "u8")))
    yield from (("record", np.zeros(array.shape, "i1,f8")), ("long text", np.array(["a" * 300])))
    yield "other byte order", array.astype(array.dtype.newbyteorder())
    for dtype in DTYPES:
        yield dtype, np.ones(array.shape, dtype)
    for number in (np.nan, np.inf, -np.inf, 1e308, 1e149, -1e299):
        if array.dtype.kind == "f":
            whole, one = np.full(array.shape, number), array.copy()
            if one.size:
                one.flat[-1] = number
            yield f"{number} once", one
            yield f"all {number}", whole
    if array.dtype.kind == "U" and row.ndim == 1 and array.size:
        for text in (ESC, "", "joint1", "joint9.x", "x" * 5000, str(row.flat[0])):
            yield f"named {text[:9]!a}", np.array([text, *row[1:]])
            yield f"ends with {text[:9]!a}", np.array([*row[:-1], text])


def change_arrays(arrays: dict[str, Any], chance: Chance) -> None:
    """Change one array: a number, all of it or its name; or leave it out."""
    key, kind = chance.choice(list(arrays)), chance.random()
    array = np.array(arrays[key])
    with np.errstate(all="ignore"):
        if kind < 0.45 and array.size and array.dtype.kind == "f":
            place = np.unravel_index(chance.randrange(array.size), array.shape)
            one = (0.0, -1.0, 1e-12, 1e12, 1e40, np.nan, np.inf, 1.01 * array[place], -array[place], array.max())
            array[place] = chance.choice(one)
            arrays[key] = array
        elif kind < 0.5 and array.dtype.kind in "fi":
            arrays[key] = array * chance.choice((0, 2, -1))
        elif kind < 0.75:
            arrays[key] = chance.choice([*(each for _, each in array_mutants(array)), *arrays.values()])
        elif kind < 0.85 or len(arrays) == 1:
            arrays[chance.choice(ARRAY_NAMES)] = array
        else:
            del arrays[key]


def change_columns(columns: Mapping[str, Any], chance: Chance) -> dict[str, Any]:
    """Return columns of which one number, some, all or the scale is extreme."""
    found = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    values = found[chance.choice(list(found))]
    size = chance.choice((*LARGE, *SMALL)) * chance.choice((1.0, -1.0))
    how = chance.choice(("one", "one", "some", "scale", "all"))
    with np.errstate(all="ignore"):
        if how == "scale":
            values *= size
        elif how == "all":
            values[...] = size
        else:
            values[[chance.randrange(len(values)) for _ in range(1 if how == "one" else 5)]] = size
    return found


def change_bytes(content: bytes, chance: Chance) -> bytes:
    """Return content that is cut short, with flipped bits, splices and insertions."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        at, other = (chance.randrange(len(content) + 1) for _ in range(2))
        kind = chance.random()
        if kind < 0.2:
            content = content[:at]
        elif kind < 0.4 and at < len(content):
            content = content[:at] + bytes([content[at] ^ 1 << chance.randrange(8)]) + content[at + 1 :]
        elif kind < 0.6:
            content = content[:at] + content[other : other + chance.randrange(60)] + content[at:]
        elif kind < 0.7:
            content = content[:at] + content[at + chance.randrange(20) :]
        else:
            content = content[:at] + chance.choice(PIECES).encode() + content[at:]
    return content


def document(kind: str, chance: Chance) -> bytes:
    """Return a document of that kind with a few changes; of TOML, one in twenty is any table."""
    is_xml = kind in ("urdf", "mjcf")
    tree = deepcopy(chance.choice(DOCUMENTS[kind]))
    for _ in range(chance.choice((0, 1, 1, 1, 1, 2, 2, 3, 6))):
        (change_element if is_xml else change_value)(tree, chance)
    if not is_xml and chance.random() < 0.05:
        tree = {**chance.choice(({}, {"name": "arm"})), **any_table(chance)}
    return (as_xml if is_xml else as_document)(tree).encode("utf-8", "surrogatepass")


def mutant(kind: str, seed: int) -> bytes:
    """Return the document of that kind and seed, one in five with damaged bytes."""
    chance = Chance(f"{kind} {seed}")
    content = document(kind, chance)
    return change_bytes(content, chance) if chance.random() < 0.2 else content


def as_xml(tree: list[Any]) -> str:
    """Return the text of a tree of elements."""
    tag, attributes, children = tree
    start = "".join([f"<{tag}", *(f" {key}={quoteattr(value)}" for key, value in attributes.items())])
    return f"{start}>{''.join(map(as_xml, children))}</{tag}>\n" if children else f"{start}/>\n"


def as_document(tree: dict[str, Any]) -> str:
    """Return the text of a tree of values, in TOML."""
    return "".join(f"{_key(key)} = {as_toml(value)}\n" for key, value in tree.items())


def toml_string(text: str) -> str:
    """Return a string of TOML in ASCII; JSON's notation has pairs of surrogates in it, which TOML does not take."""
    plain = (c if " " <= c <= "~" and c not in '"\\' else f"\\U{ord(c):08x}" for c in text)
    return '"' + "".join(plain) + '"'


def _key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else toml_string(key)


def as_toml(value: object) -> str:
    """Return a value in TOML's inline notation."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {as_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(as_toml, value)) + "]"
    if isinstance(value, str):
        return toml_string(value)
    return json.dumps(value) if isinstance(value, bool) else repr(value)


def npz(arrays: Mapping[str, Any], chance: Chance | None = None) -> bytes:
    """Return a file of arrays, packed or not; some headers are changed where there is a chance."""
    header = chance.choice(HEADERS) if chance and chance.random() < 0.3 else ""
    method = chance.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)) if chance else zipfile.ZIP_DEFLATED
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, array in arrays.items():
            inner = io.BytesIO()
            np.save(inner, array)
            data = inner.getvalue()
            if header and chance and chance.random() < 0.5:
                old = chance.choice((b"'<f8'", b"(5,)", b"(5, 3)"))
                data = data.replace(old, header.encode()[: len(old)].ljust(len(old)), 1)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), data, method)
    return stream.getvalue()
