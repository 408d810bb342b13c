/* Test support: a bare Cortex-M with an FPU that evaluates a kernel for the states of states.h and prints the bits. */

#include "states.h"

#include <stdint.h>

extern char stack_top[];
void reset(void);
void done(void);

__attribute__((section(".results"), used)) float results[STATES][N];

__attribute__((section(".vectors"), used)) void (*const vectors[16])(void) = {
    (void (*)(void))stack_top, reset, done, done, done, done, done,
};

static void host(int operation, const void *argument) /* semihosting */
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void print(const float *value)
{
    static const char digit[] = "0123456789abcdef";
    union { float number; uint32_t bits; } word;
    char text[10];
    word.number = *value;
    for (int i = 0; i < 8; i++)
        text[i] = digit[word.bits >> (28 - 4*i) & 15u];
    text[8] = '\n';
    text[9] = 0;
    host(0x04, text); /* SYS_WRITE0 */
}

void __attribute__((noinline, used)) done(void)
{
    for (;;)
        host(0x18, (const void *)0x20026); /* SYS_EXIT, as an application should */
}

void __attribute__((noinline, used)) calculated(void)
{
    for (int i = 0; i < STATES; i++)
        for (int j = 0; j < N; j++)
            print(&results[i][j]);
}

void reset(void)
{
    float h[HOISTED];
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: the FPU is there for everybody */
    __asm__ volatile("dsb\nisb");
    SETUP(parameters, h);
    for (int i = 0; i < STATES; i++)
        INVERSE_DYNAMICS(h, q[i], v[i], a[i], results[i]);
    calculated();
    done();
}
