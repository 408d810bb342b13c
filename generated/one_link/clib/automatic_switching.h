/* automatic_switching.h: automatic stiffness switching: which of the two methods with error control takes the next steps.  What
 * stiffness costs the explicit method, and accuracy the implicit one, shows on the way alone: the method that leads on further
 * for its cost goes on, and both are tried now and then.  All is counted in steps, so that a motion is the same on every machine. */

enum { EOM_TRIAL = 24, EOM_FEW_TRIALS = 8, EOM_MANY_TRIALS = 64 }; /* steps of a trial; trials' lengths of the better method */

/* Begin with a trial of the explicit method. */
EOM_LOCAL void eom_begin_switching(eom_switching *restrict switching)
{
    (void)memset(switching, 0, sizeof *switching);
    switching->method = 1;
    switching->left = EOM_TRIAL;
}

/* Count steps, rejected ones too, that cost so many evaluations each, by which the method led on for so much time, and choose the next one at the end of its turn. */
EOM_LOCAL void eom_count_steps(eom_switching *restrict switching, long long steps, double cost, double time)
{
    const int other = 1 - switching->method;
    switching->taken += steps;
    switching->led += time;
    switching->left -= steps;
    if (switching->left > 0) { return; }
    switching->worth[switching->method] = switching->led / ((double)switching->taken * cost);
    switching->tried[switching->method] = 1;
    const int is_trial = (switching->taken <= EOM_TRIAL) ? 1 : 0;
    switching->taken = 0;
    switching->led = 0.0;
    switching->left = EOM_TRIAL;
    if ((switching->tried[other] == 0) || ((switching->settled != 0) && (switching->method == switching->better) && (is_trial == 0))) {
        switching->method = other;
        return;
    }
    const int better = (switching->worth[0] > switching->worth[1]) ? 0 : 1;
    switching->length = ((switching->settled != 0) && (better == switching->better)) ? (2 * switching->length) : EOM_FEW_TRIALS;
    if (switching->length > EOM_MANY_TRIALS) { switching->length = EOM_MANY_TRIALS; }
    switching->settled = 1;
    switching->better = better;
    switching->method = better;
    switching->left = (long long)EOM_TRIAL * switching->length;
}
