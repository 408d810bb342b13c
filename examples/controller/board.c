/* Start-up code of a bare Cortex-M7 with an FPU: vectors, memory, a painted stack, SysTick as the clock. */
#include "board.h"

#include <stddef.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))

enum { UNTOUCHED = 0x5AFEC0DE, SPARED = 64 }; /* bytes under the stack pointer that painting leaves alone */

extern uint32_t data_load[], data_start[], data_end[], bss_start[], bss_end[], stack_limit[], stack_top[];
int main(void);
void reset(void);
void stop(void);
void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

__attribute__((section(".vectors"), used)) void (*const vectors[16])(void) = {
    (void (*)(void))stack_top, reset, stop, stop, stop, stop, stop, /* a fault ends the run without results */
};

/* Semihosting: the debugger, or the emulator, serves an operation. */
static void host(uint32_t operation, const void *argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void board_print(const char *text)
{
    host(0x04, text); /* SYS_WRITE0 */
}

void stop(void)
{
    for (;;) host(0x18, (const void *)0x20026); /* SYS_EXIT, as an application ends */
}

uint32_t board_clock(void)
{
    return 0xFFFFFFu - REGISTER(0xE000E018u); /* SysTick counts down */
}

uint32_t board_stack_used(void)
{
    const volatile uint32_t *word = stack_limit;
    while (word < stack_top && *word == (uint32_t)UNTOUCHED) word++;
    return (uint32_t)((uintptr_t)stack_top - (uintptr_t)word);
}

static void paint(void)
{
    uintptr_t here;
    __asm__ volatile("mov %0, sp" : "=r"(here));
    for (volatile uint32_t *word = stack_limit; (uintptr_t)word < here - SPARED; word++) *word = (uint32_t)UNTOUCHED;
}

void reset(void)
{
    REGISTER(0xE000ED88u) |= 0xFu << 20; /* CPACR: the FPU may be used */
    __asm__ volatile("dsb\nisb");
    for (size_t i = 0; &data_start[i] < data_end; i++) ((volatile uint32_t *)data_start)[i] = data_load[i];
    for (volatile uint32_t *word = bss_start; word < bss_end; word++) *word = 0;
    REGISTER(0xE000E014u) = 0xFFFFFFu; /* SysTick: reload, current value, on at the processor's clock */
    REGISTER(0xE000E018u) = 0;
    REGISTER(0xE000E010u) = 5;
    paint();
    (void)main();
    stop();
}

/* Compilers call these two even in freestanding code. */
void *memcpy(void *restrict to, const void *restrict from, size_t size)
{
    volatile unsigned char *target = to;
    const unsigned char *source = from;
    for (size_t i = 0; i < size; i++) target[i] = source[i];
    return to;
}

void *memset(void *to, int value, size_t size)
{
    volatile unsigned char *target = to;
    for (size_t i = 0; i < size; i++) target[i] = (unsigned char)value;
    return to;
}
