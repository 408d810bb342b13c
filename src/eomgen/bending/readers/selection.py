"""Selection of the stiffness and mass matrices of a file: by standard Nastran superelement names, or by given names.

Matrix names consist of the quantity and the coordinate set: KAAX, KXX or KGG.  K4XX and K4AAX are
structural damping; MUG1, MES1, MEF1, ... recover displacements, stresses and forces, and are rarely square.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import InputError
from ...identifiers import plain_path
from ...limits import MOST_MATRICES
from ...names import listed

KNOWN = ("AAX", "XX", "AA", "GG", "")  # coordinate sets, after K or M
_DAMPING = "K4"
_STRESS = "stress "
_BY_NAME, _BY_SET, _BY_LETTER, _ANY, _NONE = range(5)


@dataclass
class Selection:
    """Selection among the matrices of a file; ``wants`` is called for each header in the order of the file.

    Attributes:
        path: of the file.
        roles: quantities that the file may contain: "K", "M", or "stress CASE".
        names: matrix names given by the user, by "K", "M" or CASE.
        is_said: whether the user assigned the file to its only role; then any square matrix qualifies.
    """

    path: Path
    roles: tuple[str, ...] = ("K", "M")
    names: Mapping[str, str] = field(default_factory=dict)
    is_said: bool = False
    seen: list[str] = field(default_factory=list)
    _found: dict[str, list[tuple[int, int]]] = field(default_factory=dict)  # role -> grade and number of matrices

    def wants(self, name: str, is_square: bool) -> bool:
        """Return whether the next matrix is a candidate for a role."""
        if len(self.seen) == MOST_MATRICES:
            raise InputError(f"{plain_path(self.path)}: has more than {MOST_MATRICES} matrices; allowed: up to that")
        is_wanted = False
        for role in self.roles:
            grade, mine = self._grade(role, name, is_square), self._found.setdefault(role, [])
            is_wanted = is_wanted or (grade < _NONE and all(grade < other for other, _ in mine))
            if grade < _NONE:
                mine.append((grade, len(self.seen)))
        self.seen.append(name)
        return is_wanted

    def _grade(self, role: str, name: str, is_square: bool) -> int:
        """Return the grade of a matrix as a candidate for a role; the lowest grade is the best."""
        asked, letter = self.names.get(role.removeprefix(_STRESS)), "M" if role == "M" else "K"
        if asked is not None:
            return _BY_NAME if name == asked.upper() else _NONE
        if name in {f"{letter}{of}" for of in KNOWN}:
            return _BY_SET
        if is_square and name.startswith(letter) and not name.startswith(_DAMPING):
            return _BY_LETTER
        return _ANY if is_square and self.is_said else _NONE

    def chosen(self) -> dict[str, int]:
        """Return the index of the selected matrix of each role that the file contains.

        Raises:
            InputError: several candidates have the same grade.
        """
        result = {}
        for role, mine in self._found.items():
            surest = [number for grade, number in mine if grade == min(mine)[0]]
            if len(surest) > 1:
                names = listed(self.seen[number] for number in surest)
                key = role.removeprefix(_STRESS)
                got = f"has the matrices {names}, each of which may be {key}"
                raise InputError(f"{plain_path(self.path)}: {got}; allowed: one, or its name: --matrix-name {key}=NAME")
            if surest:
                result[role] = surest[0]
        return result
