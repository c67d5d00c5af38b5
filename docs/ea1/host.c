/* The sketch on a host, for trying it out: a board whose timer and counters are lines of text.
 *
 *   !…                            a command, as the host sends it
 *   tick t c0 c1 c2 faults buttons  the timer comes and latches this
 *   idle                          the main loop turns
 *
 * What the arm sends goes to standard output.
 */
#include "ea1.h"

#include <stdio.h>
#include <string.h>

static struct ea1_latch now;

struct ea1_latch ea1_port_latch(void)
{
    return now;
}

uint32_t ea1_port_us(void)
{
    return now.t_us;
}

void ea1_port_zero(uint8_t mask)
{
    int axis;
    for (axis = 0; axis < EA1_AXES; axis++)
        if (mask >> axis & 1)
            now.counts[axis] = 0;
}

void ea1_port_timer(uint32_t hz)
{
    (void)hz;
}

void ea1_port_send(const uint8_t *bytes, uint8_t length)
{
    fwrite(bytes, 1, length, stdout);
}

int main(void)
{
    static struct ea1 arm;
    char line[128];
    arm.model = "Bench arm";
    arm.serial = "7";
    arm.counts_per_turn[0] = 40000;
    arm.counts_per_turn[1] = 20000;
    arm.bytes_per_second = 11520;
    ea1_start(&arm);
    while (fgets(line, sizeof line, stdin)) {
        unsigned long t, faults, buttons;
        long c[EA1_AXES];
        int axis;
        if (sscanf(line, "tick %lu %ld %ld %ld %lu %lu", &t, &c[0], &c[1], &c[2], &faults, &buttons) == 6) {
            now.t_us = (uint32_t)t;
            for (axis = 0; axis < EA1_AXES; axis++)
                now.counts[axis] = (int32_t)c[axis];
            now.faults = (uint8_t)faults;
            now.buttons = (uint8_t)buttons;
            ea1_on_timer(&arm);
        } else if (!strcmp(line, "idle\n")) {
            ea1_on_idle(&arm);
        } else {
            const char *byte;
            for (byte = line; *byte; byte++)
                ea1_on_byte(&arm, (uint8_t)*byte);
        }
    }
    return 0;
}
