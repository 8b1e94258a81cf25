"""The built-in shapes, rows and margins in NumPy: what the compiled ones are compared with."""

import numpy as np

from hcbf_gym.barriers import Capsule, ConvexPolygon, Core, Disc, Ellipse, HalfPlane, SpeedLimit

TINY = 1e-9


def reserved(confidence, deviation):
    """Return what is reserved for a standard deviation."""
    return confidence * deviation


def jet(barrier, q):
    """Return H, ∇H and ∇²H of a shape at the position q in its frame."""
    return TEXTS[type(barrier)][0](barrier, q)


def core(barrier, q, reach):
    """Return the core of a shape."""
    return TEXTS[type(barrier)][1](barrier, q, reach)


def half_plane_jet(wall, q):
    normal = np.array(wall.normal)
    return float(normal @ q - wall.offset), normal, np.zeros((2, 2))


def half_plane_core(wall, q, reach):
    return Core(np.inf, np.inf, False)


def disc_jet(disc, q):
    distance, direction, curvature = norm_jet(q - np.array(disc.center))
    return distance - disc.radius, direction, curvature


def disc_core(disc, q, reach):
    return Core(jet(disc, q)[0] + disc.radius, disc.radius, True)


def ellipse_core(ellipse, q, reach):
    radius = min(ellipse.semi_axes) ** 2 / max(ellipse.semi_axes)
    return Core(jet(ellipse, q)[0] + radius, radius, False)


def capsule_jet(capsule, q):
    start, vector = np.array(capsule.start), np.subtract(capsule.end, capsule.start)
    share = np.clip((q - start) @ vector / (vector @ vector), 0.0, 1.0)
    distance, direction, curvature = norm_jet(q - start - share * vector)
    flat = np.zeros((2, 2))
    return distance - capsule.radius, direction, flat if 0.0 < share < 1.0 else curvature


def capsule_core(capsule, q, reach):
    h, start = jet(capsule, q)[0], np.array(capsule.start)
    vector = np.subtract(capsule.end, capsule.start)
    length = float(np.linalg.norm(vector))
    along, away = float((q - start) @ vector) / length, h + capsule.radius
    beside = reach <= along <= length - reach and (h > 0.0 or away >= reach)
    at_end = along <= -reach or along >= length + reach
    return Core(np.inf if beside else away, capsule.radius, at_end)


def polygon_jet(polygon, q):
    corners = np.array(polygon.vertices)
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / lengths[:, None]
    heights = np.sum(normals * (q - corners), axis=1)
    nearest = int(np.argmax(heights))
    along = np.clip(np.sum((q - corners) * edges, axis=1) / lengths**2, 0.0, 1.0)
    offsets = q - (corners + along[:, None] * edges)
    closest = int(np.argmin(np.linalg.norm(offsets, axis=1)))
    distance, direction, curvature = norm_jet(offsets[closest])
    if heights[nearest] <= 0.0 or distance < TINY:
        return float(heights[nearest]), normals[nearest], np.zeros((2, 2))
    if 0.0 < along[closest] < 1.0:
        return distance, normals[closest], np.zeros((2, 2))
    return distance, direction, curvature


def polygon_core(polygon, q, reach):
    h, corners = jet(polygon, q)[0], np.array(polygon.vertices)
    if h <= 0.0:
        return Core(np.inf, 0.0, False)
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    along = np.sum((q - corners) * edges, axis=1) / lengths
    above = edges[:, 1] * (q - corners)[:, 0] - edges[:, 0] * (q - corners)[:, 1] > 0.0
    if (above & (along >= reach) & (along <= lengths - reach)).any():
        return Core(np.inf, 0.0, False)
    beyond = np.roll(along - lengths, 1)  # past the end of the edge before
    return Core(h, 0.0, bool(((beyond >= reach) & (along <= -reach)).any()))


def held_row(barrier, x, t, settings, margin, margin_rate, quickening=0.0):
    """Return a, b, h and α₂(ψ) of a built-in barrier while u is held."""
    period, u_max = settings.period, settings.u_max
    alpha1, alpha2, half = settings.alpha1, settings.alpha2, 0.5 * u_max * period**2
    if isinstance(barrier, SpeedLimit):
        alpha = settings.alpha_speed
        velocity, v_max = x[2:], barrier.v_max
        h = (v_max**2 - velocity @ velocity) / (2.0 * v_max)
        kept, cost = h - margin, u_max**2 * period / (2.0 * v_max)
        b = max(-alpha(kept), cost - kept / period) if kept >= 0.0 else cost - alpha(kept)
        b = min(b, float(velocity @ velocity) / (v_max * period))
        return -velocity / v_max, b + margin_rate, h, alpha(kept)
    q, r = x[:2] - barrier.frame_velocity * t, x[2:] - barrier.frame_velocity
    reach = float(np.linalg.norm(r)) * period + half
    h, gradient, hessian = jet(barrier, q)
    distance, radius, is_point = core(barrier, q, reach)
    kept, rate = h - margin - max(0.0, half - radius), float(gradient @ r) - margin_rate
    psi, end = rate + alpha1(kept), kept + rate * period
    sideways = np.sqrt(max(0.0, distance * float(r @ hessian @ r))) if is_point else 0.0
    nu = turning(distance, sideways, reach, period, u_max) + quickening * period
    chord = min(alpha1.derivative(end - half), alpha1.derivative(end + half))
    promised = alpha1(end - half) + chord * half
    b = (psi - period * alpha2(psi) - rate + nu - promised) / (period + 0.5 * chord * period**2)
    if kept >= 0.0 and end >= 0.0:
        b = max(b, -2.0 * end / period**2)
    if psi < 0.0 and rate < 0.0 < kept:
        most = u_max * float(np.linalg.norm(gradient))
        most = most if settings.limits is None else min(most, support(gradient, settings.limits))
        b = max(b, min(rate**2 / (2.0 * kept) + nu / period, most))
    return gradient, b, h, alpha2(psi)


def usual_row(barrier, x, t, settings, margin, margin_rate, quickening=0.0):
    """Return a, b, h and α₂(ψ) of a built-in barrier at this instant alone."""
    alpha1, alpha2 = settings.alpha1, settings.alpha2
    if isinstance(barrier, SpeedLimit):
        velocity, v_max = x[2:], barrier.v_max
        h = (v_max**2 - velocity @ velocity) / (2.0 * v_max)
        bound = settings.alpha_speed(h - margin)
        return -velocity / v_max, margin_rate - bound, h, bound
    r = x[2:] - barrier.frame_velocity
    h, gradient, hessian = jet(barrier, x[:2] - barrier.frame_velocity * t)
    kept, rate = h - margin, float(gradient @ r) - margin_rate
    psi, lost = rate + alpha1(kept), quickening - float(r @ hessian @ r)
    b = lost - alpha1.derivative(kept) * rate - alpha2(psi)
    if psi < 0.0 and rate < 0.0 < kept and settings.u_max is not None:
        most = settings.u_max * float(np.linalg.norm(gradient))
        most = most if settings.limits is None else min(most, support(gradient, settings.limits))
        b = max(b, min(rate**2 / (2.0 * kept) + lost, most))
    return gradient, b, h, alpha2(psi)


def support(a, limits):
    """Return the most that a box gives of a·u."""
    return float(np.maximum(a * np.array(limits[0]), a * np.array(limits[1])).sum())


def turning(distance, sideways, reach, period, u_max):
    """Return ν."""
    if np.isinf(distance):
        return 0.0
    mean = max(0.5 * u_max * period**2, 0.5 * (distance + max(distance - reach, 0.0)))
    loss = u_max**2 * period**3 / (16.0 * mean)
    across = max(0.0, sideways - 0.5 * u_max * period)
    gain = distance**2 / (distance + reach) ** 3 * across**2 * period
    return loss - max(0.0, float(np.sqrt(gain) - np.sqrt(loss))) ** 2


def norm_jet(r):
    """Return ‖r‖, its gradient and its Hessian; at r = 0 the direction is taken along +x."""
    distance = float(np.linalg.norm(r))
    if distance < TINY:
        return distance, np.array([1.0, 0.0]), np.zeros((2, 2))
    direction = r / distance
    return distance, direction, (np.eye(2) - np.outer(direction, direction)) / distance


def ellipse_jet(ellipse, q):
    """Return H, ∇H and ∇²H of an ellipse, its nearest point found among many and then by Newton."""
    cos, sin = np.cos(ellipse.angle), np.sin(ellipse.angle)
    turned, (a, b) = np.array([[cos, sin], [-sin, cos]]), ellipse.semi_axes
    u, v = turned @ (q - np.array(ellipse.center))
    turn = np.linspace(0.0, 2.0 * np.pi, 20001)
    t = turn[np.argmin((a * np.cos(turn) - u) ** 2 + (b * np.sin(turn) - v) ** 2)]
    for _ in range(20):
        x, y, dx, dy = a * np.cos(t), b * np.sin(t), -a * np.sin(t), b * np.cos(t)
        slope = (x - u) * dx + (y - v) * dy
        t -= slope / (dx * dx + dy * dy - (x - u) * x - (y - v) * y)
    normal = np.array([b * np.cos(t), a * np.sin(t)])
    size = float(np.linalg.norm(normal))
    normal /= size
    h = float((u - a * np.cos(t)) * normal[0] + (v - b * np.sin(t)) * normal[1])
    tangent = turned.T @ np.array([-normal[1], normal[0]])
    return h, turned.T @ normal, np.outer(tangent, tangent) / (size**3 / (a * b) + h)


TEXTS = {
    HalfPlane: (half_plane_jet, half_plane_core),
    Disc: (disc_jet, disc_core),
    Ellipse: (ellipse_jet, ellipse_core),
    ConvexPolygon: (polygon_jet, polygon_core),
    Capsule: (capsule_jet, capsule_core),
}
"""The jet and the core of each built-in shape."""
