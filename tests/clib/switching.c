/* Methods that automatic switching chooses: of pairs of steps and times on the input the method and the steps left behind each. */
#include "eom.h"

#include <stdio.h>
#include <string.h>

#include "precision.h"
#include "automatic_switching.h"

int main(void)
{
    eom_switching switching;
    long long steps = 0;
    double cost = 0.0;
    double time = 0.0;
    eom_begin_switching(&switching);
    printf("%d %lld\n", switching.method, switching.left);
    while (scanf("%lld %lf %lf", &steps, &cost, &time) == 3) {
        eom_count_steps(&switching, steps, cost, time);
        printf("%d %lld\n", switching.method, switching.left);
    }
    return 0;
}
