"""A bar of eight-node bricks as finite elements: writes bar.npz, from which eomgen reduce makes a link that bends.

Every program of finite elements has such matrices; this one is small enough to be read.  SI units.
"""

import itertools

import numpy as np
from scipy.sparse import coo_matrix

CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))
GAUSS = np.array(list(itertools.product((-(3**-0.5), 3**-0.5), repeat=3)))


def brick(size, E, nu, density):
    """Return stiffness and mass matrices of a brick with edges ``size``, (24, 24): x, y and z of each corner."""
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    C = np.diag([2 * mu] * 3 + [mu] * 3)
    C[:3, :3] += lam
    K, M, volume = np.zeros((24, 24)), np.zeros((24, 24)), np.prod(size) / 8
    for point in GAUSS:
        factors = (1 + CORNERS * point) / 2
        N = factors.prod(1)
        dN = np.array([CORNERS[:, d] / size[d] * np.delete(factors, d, 1).prod(1) for d in range(3)])
        B = np.zeros((6, 24))
        for d in range(3):
            B[d, d::3] = dN[d]
        for row, (a, b) in enumerate(((0, 1), (1, 2), (0, 2)), 3):
            B[row, a::3], B[row, b::3] = dN[b], dN[a]
        K += volume * B.T @ C @ B
        M += volume * density * np.kron(np.outer(N, N), np.eye(3))
    return K, M


def bar(length=1.0, width=0.1, height=0.06, counts=(8, 2, 2), E=2e8, nu=0.3, density=2000.0):
    """Return nodes, (N, 3), and the sparse stiffness and mass matrices of a bar along x, from x = 0 on."""
    axes = [np.linspace(0, length, counts[0] + 1)]
    axes += [np.linspace(-s / 2, s / 2, n + 1) for s, n in zip((width, height), counts[1:], strict=True)]
    nodes = np.array(list(itertools.product(*axes)))
    number = np.arange(len(nodes)).reshape([n + 1 for n in counts])
    first = np.array(list(np.ndindex(*counts)))
    corners = np.array([number[tuple((first + (c + 1) // 2).T)] for c in CORNERS]).T
    dofs = (3 * corners[:, :, None] + np.arange(3)).reshape(len(corners), 24)
    rows, columns = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, 24).ravel()
    size = np.array([length, width, height]) / counts
    matrices = []
    for element in brick(size, E, nu, density):
        entries = np.tile(element.ravel(), len(corners))
        matrices.append(coo_matrix((entries, (rows, columns)), shape=(3 * len(nodes),) * 2).tocsr())
    return nodes, *matrices


if __name__ == "__main__":
    nodes, K, M = bar()
    K, M = K.tocoo(), M.tocoo()
    tip = np.flatnonzero(nodes[:, 0] == 1.0)
    np.savez(
        "bar.npz",
        nodes=nodes,
        dofs=[(node, direction) for node in range(len(nodes)) for direction in range(3)],
        K_row=K.row,
        K_col=K.col,
        K_data=K.data,
        M_row=M.row,
        M_col=M.col,
        M_data=M.data,
        root=np.flatnonzero(nodes[:, 0] == 0.0),
        interface_names=["tip"],
        interface_kinds=["rbe2"],
        interface_counts=[len(tip)],
        interface_nodes=tip,
        interface_places=[[1.0, 0.0, 0.0]],
        count=6,
    )
