/* What the example needs of a board: a clock, and words to a debugger. */
#ifndef BOARD_H
#define BOARD_H

#include <stdint.h>

uint32_t board_clock(void);              /* counts up, BOARD_CLOCK times a second, modulo 2^24 */
void board_print(const char *text);      /* to whoever listens: semihosting */
uint32_t board_stack_used(void);         /* bytes of the stack that were written since reset */

enum { BOARD_CLOCK = 25000000 };

#endif
