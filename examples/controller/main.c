/* The loop of a controller at 1 kHz, fed with the states of task.h instead of sensors; it prints what it computed.
 *
 * Lines: "u" and the bits of a step's drives, "c" and the clock's counts of all steps and of reading the clock as
 * often, "s" and the bytes of stack; all in hexadecimal digits. */
#include "board.h"
#include "controller.h"
#include "task.h"

static controller arm;
static float drives[STEPS][DOF];

static void print(char kind, const uint32_t *words, int count)
{
    static const char digit[] = "0123456789abcdef";
    char text[2 + 9 * DOF + 2];
    int at = 0;
    text[at++] = kind;
    for (int i = 0; i < count; i++) {
        text[at++] = ' ';
        for (int shift = 28; shift >= 0; shift -= 4) text[at++] = digit[(words[i] >> shift) & 15u];
    }
    text[at++] = '\n';
    text[at] = 0;
    board_print(text);
}

static uint32_t bits(float number)
{
    union { float number; uint32_t bits; } word;
    word.number = number;
    return word.bits;
}

int main(void)
{
    uint32_t counts[2] = { 0, 0 }, words[DOF];
    controller_start(&arm, parameters, kp, kd, from, to, duration);
    for (int k = 0; k < STEPS; k++) {
        const uint32_t before = board_clock();
        controller_step(&arm, (float)k * period, q[k], v[k], drives[k]);
        counts[0] += (board_clock() - before) & 0xFFFFFFu;
    }
    const uint32_t used = board_stack_used(); /* of the loop, not of printing */
    for (int k = 0; k < STEPS; k++) {
        const uint32_t before = board_clock();
        counts[1] += (board_clock() - before) & 0xFFFFFFu;
    }
    for (int k = 0; k < STEPS; k++) {
        for (int i = 0; i < DOF; i++) words[i] = bits(drives[k][i]);
        print('u', words, DOF);
    }
    print('c', counts, 2);
    print('s', &used, 1);
    return 0;
}
