r"""What a row reserves between h and zero, from what is uncertain at this moment.

For a barrier on the position with the unit normal n = ∇h/‖∇h‖,

.. math::
    m = d + k_v \max(0, -n·e_v) + k_p \max(0, n·e_p) + \max(0, n·(p - b)) + κσ + ρ,

where e = (e_p, e_v) is the body's state minus the reduced-order model's (the tracking error), p the
position that the row reads, b the body's, σ the standard deviation of the estimated position, and ρ
what the body reaches beyond its centre. The first three parts are for the reduced-order model, in
which the body moves at the model's velocity: a body that moves faster towards the region will get
there by k_v e_v more, and one whose model has run ahead of it will be drawn after it. The fourth is
for rows that read the model's own position: a body that is nearer has no less than that of h. As
‖∇h‖ ≤ 1, no part is more than h can lose; none is multiplied by ‖∇h‖, which rises along the side of
an ellipse. A speed limit reserves d_s + k_s ‖e_v‖ + κ √λ(P_vv)
[m/s], with λ the largest eigenvalue: a body that does not follow may overshoot, too, and one that
follows needs little.

With P the covariance of the state, beside a wall σ = √(nᵀ P_pp n). Where n turns as the robot
moves, σ = √λ(P_pp) is that of the worst direction. Over a hold T it grows by no more than

.. math:: \dot m T, \qquad \dot m = κ \sqrt{n^T P_{vv}(T) n} \text{ or } κ \sqrt{λ(P_{vv}(T))},

as deviations add up at most: σ(T) ≤ σ + T σ_v. P_vv(T) ≤ P_vv + g is what the velocity's will be at
the end of the hold, g what it grew by since the last sample. ṁ stands in the row, and so does its
own growth m̈. The tracking error's part decays where the model is right, and is bounded by `cap`, so
that one sample can take at most that much away.

Any model ẋ = f(x) + g(x)u and any h(x) reserve the same. Let p be the position in x, a = ∇h with
‖a_p‖ ≥ 1 where h reads p, e_v the difference of ṗ between body and model under one input, and
V = (∂f/∂x) P (∂f/∂x)ᵀ the covariance of the drift, which is P_vv of a double integrator. Then

.. math::
    m = ‖a_p‖ (d + ρ) + \min(‖a_p‖\,\mathrm{cap}, \dots) + \max(0, a·(x - x_b)) + κ σ(a, P),
    \qquad \dot m = κ σ(a, V),

with σ(a, C) = √(aᵀ C a) beside a wall, and ‖a_p‖ √λ(C_pp) + √(a_rᵀ C_rr a_r) elsewhere, r the rest
of x. Where g is not the same everywhere (a heading that is not known), a hold adds T κ Σ σ(a, W_j)
to m, W_j the covariance of g_j(x) u_j for the largest u_j. An h that is not convex adds what it may
lose in second order.
"""
