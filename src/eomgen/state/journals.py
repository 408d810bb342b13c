"""Journals of a kernel's joints in round bearings: where they are, and how far beyond their clearance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..kernel.complete import Kernel
from ..names import component_name
from ..robot.elements.journal import CROSSWISE, RADIAL, TILTING
from ..robot.parameter_names import BEARINGS, CUT_BEARINGS
from .elements import element_numbers

Numbers = Mapping[str, Mapping[str, float]]  # by joints, then by their names in ``Radial.NUMBERS``


@dataclass(frozen=True)
class JournalContact:
    """A place where a journal may touch its bearing.

    Arguments q are coordinates of the kernel, of a loop joint's journal deviations by the order of ``cut_laws``.

    Attributes:
        name: "JOINT.radial", "LOOP.radial".
        end: 1 or -1, the end of the bearing towards positive or negative z; 0 of one without a length.
        clearance: m.
        stiffness: N/m.
        height: of the place over the joint's origin along the journal's axis, m.
        index: in q of x, y and, of a bearing with a length, alpha and beta.
    """

    name: str
    end: int
    clearance: float
    stiffness: float
    height: float
    index: tuple[int, ...]

    def centre(self, q: Array) -> Array:
        """Return the journal's centre off the bearing's, (..., 2), m, in the axes of x and y; q is (..., n)."""
        x, y = (q[..., i] for i in self.index[:2])
        if self.end:
            alpha, beta = (q[..., i] for i in self.index[2:])
            x, y = x + self.height * np.sin(beta), y - self.height * np.sin(alpha) * np.cos(beta)
        return np.stack([x, y], axis=-1)

    def penetration(self, q: Array) -> Array:
        """Return the penetration: how far the centre is beyond the clearance, (...,), m, below 0 inside."""
        penetration: Array = np.linalg.norm(self.centre(q), axis=-1) - self.clearance
        return penetration

    def centre_jacobian(self, q: Array) -> Array:
        """Return derivatives of the centre by the coordinates of ``index``, (2, 2) or (2, 4), at one q."""
        if not self.end:
            return np.eye(2)
        alpha, beta = (q[i] for i in self.index[2:])
        h, (sa, ca), (sb, cb) = self.height, (np.sin(alpha), np.cos(alpha)), (np.sin(beta), np.cos(beta))
        return np.array([[1.0, 0.0, 0.0, h * cb], [0.0, 1.0, -h * ca * cb, h * sa * sb]])


def journal_contacts(kernel: Kernel) -> list[JournalContact]:
    """Return the contacts of all journals of joints with the numbers that the kernel has now."""
    return contacts_of(element_numbers(kernel, BEARINGS), kernel.coordinates)


def contacts_of(journals: Numbers, coordinates: Sequence[str]) -> list[JournalContact]:
    """Return the contacts of journals of these numbers, in q of these coordinates."""
    contacts: list[JournalContact] = []
    for joint, numbers in journals.items():
        length = numbers.get("length")
        names = CROSSWISE if length is None else (*CROSSWISE, *TILTING)
        index = tuple(coordinates.index(component_name(joint, name)) for name in names)
        for end in (0,) if length is None else (1, -1):
            height = 0.0 if length is None else 0.5 * end * length
            name = component_name(joint, RADIAL)
            contacts.append(JournalContact(name, end, numbers["clearance"], numbers["stiffness"], height, index))
    return contacts


def cut_contacts(kernel: Kernel) -> list[JournalContact]:
    """Return the contacts of the journals of loop joints, in deviations as of ``Functions.cut_forces``."""
    return contacts_of(element_numbers(kernel, CUT_BEARINGS), kernel.cut_laws)


def cut_deviations(kernel: Kernel, q: Array) -> Array:
    """Return deviations of what is in ``cut_laws`` at q, (..., n)."""
    deviations: Array = kernel.functions.cut_forces(q, np.zeros_like(q))[..., 0]
    return deviations


def cut_stiffness(kernel: Kernel, q: Array) -> Array:
    """Return the stiffness matrix of the journals of loop joints at q where all touch along x and along y, (n, n)."""
    contacts = cut_contacts(kernel)
    if not contacts:
        return np.zeros((kernel.n, kernel.n))
    return _stiffness(contacts, cut_deviations(kernel, q), np.asarray(kernel.functions.cut_jacobian(q)))


def journal_stiffness(kernel: Kernel) -> Array:
    """Return the stiffness matrix of all journals where all of their contacts touch along x and along y, (n, n)."""
    return _stiffness(journal_contacts(kernel), np.zeros(kernel.n), np.eye(kernel.n))


def _stiffness(contacts: Sequence[JournalContact], s: Array, J: Array) -> Array:
    """Return the stiffness of contacts in deviations s, whose derivatives by q are J."""
    rows = [(contact.stiffness, contact.centre_jacobian(s) @ J[list(contact.index)]) for contact in contacts]
    return sum((k * (row.T @ row) for k, row in rows), np.zeros((J.shape[1],) * 2))
