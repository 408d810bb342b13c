/* What the loop needs of the operating system, by POSIX. */
#ifndef REALTIME_H
#define REALTIME_H

/* Lock memory, touch the stack, ask for SCHED_FIFO with a priority (0: do not); prints what is granted. */
void realtime_begin(int priority);

long long realtime_now(void);              /* ns of a clock that never jumps */
void realtime_sleep_until(long long time); /* ns of that clock */
long realtime_page_faults(void);           /* of this process up to now */

#endif
