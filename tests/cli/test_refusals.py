"""What commands refuse, by name, before anything is read, computed or written: usage with status 2, input with 1."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.commands import run

CHECK = "check one_link --float32 --kernels inverse_dynamics"
FORMAT = "given without its format; allowed: with"
ENDINGS = (
    *("deflection one_link", "modes one_link", "response one_link", "linearize one_link", "fit one_link gone.csv"),
    *("identify one_link gone.csv", "excite one_link", "calibrate one_link gone.csv", "poses one_link"),
    *("tolerance one_link gone.toml", "compensate one_link", "accuracy gone.csv", "budget gone.npz"),
    "forces one_link gone.csv",
)
USAGE = [  # words, and what is said, as a regular expression
    *((words, "") for words in ("", "nonsense", "info", "info ur5 --inertia guess", "bench")),
    *(
        (words, "argument {0[1]}: '{0[2]}'; allowed: ")
        for words in (
            "simulate ur5 --duration 1e300",
            "modes puma560_elastic --along gone --points 2147483648",
            "response puma560_elastic --points 2147483648",
            "excite ur5 --starts 100000000000000000000",
        )
    ),
    *(
        (words, r"invalid choice: '{0[2]}' \(choose from ")
        for words in (
            "schema robots",
            "calibrate ur5 p.csv --loss tukay",
            "poses ur5 --criterion E",
            "excite ur5 --terms links wet",
            "simulate ur5 --method euler",
        )
    ),
    ("generate one_link --levels v1 --native", "argument --native: not allowed with argument --levels"),
    ("measure simulate one_link", "invalid choice: 'simulate'"),
    # an option twice: the first value is not dropped
    ("simulate ur5 --duration 1 --duration 1", "argument --duration: given more than once; allowed: once"),
    ("excite ur5 --sample-time 1 --step 2", "argument --step: given more than once; allowed: once"),
    ("info ur5 --json --json", "argument --json: given more than once; allowed: once"),
    # what steers a terminal
    ("info ur5 --\x1b[2J", r"unrecognized arguments: --\\x1b\[2J"),
    ("info ur5 -o\x07\u202e", r"unrecognized arguments: -o\\x07\\u202e"),
    ("excite ur5 --h=\x1b[2J", r"ambiguous option: --h=\\x1b\[2J"),
    # what is no number
    *(
        (f"modes one_link --points {text}", rf"argument --points: '{text}'; allowed: a whole number")
        for text in ("-1e-2", "-inf", "-NaN", "-.5x")
    ),
    *(
        (f"{words} -o trajectory.npz", "trajectory.npz'; allowed: a path that ends in .html")
        for words in ("report trajectory.npz", "view one_link", "live one_link")
    ),
]
REFUSED = [
    ("info pumma560", "pumma560.*puma560"),
    ("info missing.toml", "missing.toml"),
    ("generate one_link -o /dev/null/x --kernels mass_matrix", "/dev/null/x"),
    (f"generate one_link -o {'x' * 300} --kernels mass_matrix", "x/one_link cannot be written: File name too long"),
    ("simulate ur5 --goal 1", "goal.*6 numbers"),
    ("simulate ur5 --duration -1", "duration.*-1.0"),
    # a name twice: the last value does not silently take the place of the first
    ("deflection one_link --load tcp 0 0 1 0 0 0 --load tcp 1 0 0 0 0 0", "load: 'tcp' is given twice; allowed: once"),
    ("deflection one_link --set gravity.z=0 gravity.z=-1", "set: 'gravity.z' is given twice"),
    ("modes one_link --state one.x.friction.z=1 one.x.friction.z=2", "state: 'one.x.friction.z' is given twice"),
    ("modes one_link --pose joint1.gamma=1 joint1.gamma=2", "pose: 'joint1.gamma' is given twice"),
    ("modes one_link --drives pd --kp joint1.gamma=1 joint1.gamma=2", "kp: 'joint1.gamma' is given twice"),
    ("poses ur5 --range joint1.gamma 0 1 --range joint1.gamma 0 1", "range: 'joint1.gamma' is given twice"),
    ("excite ur5 --box tcp 0 0 0 1 1 1 --box tcp 0 0 0 2 2 2", "box: 'tcp' is given twice"),
    ("compensate ur5 --scenario gone.toml --weights x=1 x=2", "weights: 'x' is given twice"),
    ("info robot.xacro --xacro --package arm=a --package arm=b", "package: 'arm' is given twice"),
    ("reduce a.sti --mean tip=1 --mean tip=2", "mean: 'tip' is given twice; allowed: once"),
    # endings
    *((f"{x} -o a.doc", r"^eomgen: output: '?a\.doc'?; allowed: (a path|paths) that ends? in \.") for x in ENDINGS),
    ("identify one_link gone.csv --toml a.doc", "toml: 'a.doc'; allowed: a path that ends in .toml"),
    ("calibrate one_link gone.csv --toml a.doc", "toml: 'a.doc'; allowed: a path that ends in .toml"),
    ("calibrate one_link gone.csv --urdf a.doc", "urdf: 'a.doc'; allowed: a path that ends in .urdf"),
    ("reduce bar.npz -o modes.txt", "output: 'modes.txt'; allowed: a path that ends in .npz"),
    # options of another one
    ("export one_link --mjcf --kernels mass_matrix", f"--kernels: {FORMAT} --arrays or --wasm"),
    ("export one_link --arrays --dtype float32", f"--dtype: {FORMAT} --wasm"),
    ("export one_link --wasm --fmi 3", f"--fmi: {FORMAT} --fmu"),
    ("export one_link --fmu --mjcf --model", f"--model: {FORMAT} --wasm"),
    ("export one_link --arrays --step 1e-3", f"--step: {FORMAT} --fmu or --mjcf"),
    ("export one_link --fmu --approximate", f"--approximate: {FORMAT} --mjcf"),
    ("check one_link --range q 0 1", "--range: given without --float32; allowed: with it"),
    ("check one_link --kernels energy", "--kernels: given without --float32; allowed: with it"),
    (f"{CHECK} --range joint7.x 0 1", "range of 'joint7.x': no such input"),
    ("generate one_link --kernels mass_matrix,engy", "kernels: 'engy' is unknown; allowed: mass_matrix"),
    ("generate one_link --levels v1,v2", "levels: 'v2' is unknown; allowed: v1, v3, v4, all"),
    ("reduce bar.npz --rigid tip", "rigid: 'tip'; allowed: NAME=SET"),
    ("reduce bar.npz --stress body.x.x", "stress: 'body.x.x'; allowed: CASE=FILE"),
    ("reduce none.npz", "none.npz: cannot be read"),
    ("reduce arm.step", r"files: arm.step; allowed: .npz \(finite elements of eomgen\); .sti, .mas, .dof \(CalculiX\)"),
]


@pytest.mark.parametrize(
    ("words", "said", "code"),
    [*((*case, 2) for case in USAGE), *((*case, 1) for case in REFUSED)],
    ids=[words or "nothing" for words, _ in (*USAGE, *REFUSED)],
)
def test_refusals(words: str, said: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*words.split())
    assert (status, out) == (code, ""), err
    assert "Traceback" not in err
    pattern = said.format(["", *words.split()[-2:]]) if code == 2 else said
    assert err.replace("\n", "").isprintable()
    assert re.search(pattern, " ".join(err.split())), err
    assert not list(tmp_path.iterdir())
