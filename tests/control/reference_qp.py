"""The limits of one cycle as a QP for a general solver: the reference's other half."""

import numpy as np

from dovetail.types import Array


def solve_qp(
    M: Array, a0: Array, lb: Array, ub: Array, walls: tuple | None = None,
    torque: tuple | None = None, rho: float = 1.0,
) -> Array:  # fmt: skip
    """Min |a - a0|_M^2 + rho |s|^2 in the box: walls soft by s, torque rows hard."""
    import qpsolvers

    G, h, P = np.empty((0, 10)), [], np.eye(10)  # unknowns a and sqrt(rho) s
    P[:7, :7] = M
    for rows, soft in ((walls, -np.eye(3) / np.sqrt(rho)), (torque, np.zeros((7, 3)))):
        if rows is not None:
            A, offset, low, high = rows
            G = np.vstack([G, np.hstack([A, soft]), np.hstack([-A, soft])])
            h += [*(high - offset), *(offset - low)]
    low = np.append(lb - 1e-11, [-1e6] * 3)  # quadprog takes lb = ub for a
    high = np.append(ub + 1e-11, [1e6] * 3)  # contradiction
    cost, h = -P @ np.append(a0, np.zeros(3)), np.array(h)
    x = qpsolvers.solve_qp(P, cost, G, h, lb=low, ub=high, solver="quadprog")
    if x is None:
        raise ArithmeticError("the joint box and the torque limits exclude each other")
    return np.clip(x[:7], lb, ub)
