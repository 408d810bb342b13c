#define _POSIX_C_SOURCE 200809L
#define _DEFAULT_SOURCE /* mlockall, getrusage */
#include "realtime.h"

#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>

enum { STACK = 256 * 1024, SECOND = 1000000000 }; /* bytes that the loop may need; ns */

/* Write to every page of the stack, so that the loop finds them there. */
static void touch_stack(void)
{
    volatile unsigned char stack[STACK];
    for (int i = 0; i < STACK; i += 1024) { stack[i] = 1; }
    (void)stack[0];
}

void realtime_begin(int priority)
{
    const struct sched_param wanted = { .sched_priority = priority };
    if (mlockall(MCL_CURRENT | MCL_FUTURE) == 0) {
        puts("memory: locked");
    } else {
        printf("memory: not locked (%s); allow it by ulimit -l, or run as root\n", strerror(errno));
    }
    touch_stack();
    if (priority == 0) {
        puts("scheduler: as it was");
    } else if (sched_setscheduler(0, SCHED_FIFO, &wanted) == 0) {
        printf("scheduler: SCHED_FIFO, priority %d\n", priority);
    } else {
        printf("scheduler: as it was; no SCHED_FIFO (%s); allow it by ulimit -r, or run as root\n", strerror(errno));
    }
}

long long realtime_now(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (long long)now.tv_sec * SECOND + now.tv_nsec;
}

void realtime_sleep_until(long long time)
{
    const struct timespec until = { .tv_sec = (time_t)(time / SECOND), .tv_nsec = (long)(time % SECOND) };
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR) { } /* a signal: not yet */
}

long realtime_page_faults(void)
{
    struct rusage usage;
    (void)getrusage(RUSAGE_SELF, &usage);
    return usage.ru_minflt + usage.ru_majflt;
}
