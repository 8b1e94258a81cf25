"""Is the plant the one that was declared? What was chosen and what is observed tell.

**The input.** At every sample the state's change over one period is compared with what the model
makes of the chosen input. The difference, as an input Δu, says two things.

``model_error`` is its root mean square with the time constant `WINDOW`,
``E ← E + (T/τ)(‖Δu‖² − E)``.

The alarm counts samples, so that it makes no difference how large they are. A sample tells
something where the filter asked for something, ``‖u‖ > FLOOR ū`` with ū the largest input; then it
is missed where ``‖Δu‖ > SHARE ‖u‖``. The alarm is raised where most of the last `TELLING` samples
that tell were missed. A gain of 2 misses every one that is not cut off at the limits.

A double integrator that meets most of them to ``‖Δu‖ ≤ EXACT ‖u‖`` is exact, and few
misses are significant there: where more than `FEW` of them are off by ``OFF_EXACT ‖u‖``, that
alarms, too. So every third input that is reversed, or braking that is weakened, is seen.

**The motion.** With s what no input explains of the change from one sample to the next, Δ the
change, and ``τ = WINDOW``, over every sample of length T,

    r ← (1 − T/τ) r + s,   m ← (1 − T/τ) m + Δ,   m' ← (1 − T/τ) m' + Δ − s,
    c ← (1 − T/τ) c + APART T ‖ẋ' − ẋ‖.

The alarm is raised where at `IN_A_ROW` samples ``‖r‖ > rest + OFF max(‖m‖, ‖m'‖) + c + κ √tr P``: c
is what two ways to integrate may be apart, where the velocity turns or changes. Of a planar double
integrator s is ``Δp − T (v + v')/2``, which is exact, so that c is 0 of one that is its model;
`model_monitor.hpp` has s for any model.

The core computes it and has the numbers in capitals: `monitor.hpp`.
"""
