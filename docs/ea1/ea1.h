/* EA1 for the arm's side: see ../ea1.md. Plain C99, no allocation, no library but stdint.h. */
#ifndef EA1_H
#define EA1_H

#include <stdint.h>

#define EA1_AXES 3
#define EA1_LONGEST_LINE 128
#define EA1_BLOCK 29

/* What one latch gives. */
struct ea1_latch {
    uint32_t t_us;             /* free-running microseconds */
    int32_t counts[EA1_AXES];  /* base first */
    uint8_t faults;            /* bit per joint: its counter lost steps since the last latch */
    uint8_t buttons;           /* bit per button */
};

/* One arm. Fill in the first four fields, zero the rest. */
struct ea1 {
    const char *model;                 /* printable, no comma, star or dollar, at most 24 characters */
    const char *serial;                /* the same */
    uint32_t counts_per_turn[EA1_AXES];
    uint32_t bytes_per_second;         /* what the line carries: baud rate / 10 */

    uint32_t seq;
    uint32_t rate_hz;
    uint8_t as_blocks;
    uint8_t homed, faults;             /* bit per joint; faults stay until the joint is zeroed */
    volatile uint8_t waiting;          /* a latch is in the slot */
    volatile uint8_t overrun;          /* a latch found the slot full */
    struct ea1_latch slot;
    uint32_t slot_seq;
    char command[16];
    uint8_t command_length;
};

/* What the board provides. */
struct ea1_latch ea1_port_latch(void);            /* all counters at one instant, and that instant */
uint32_t ea1_port_us(void);
void ea1_port_zero(uint8_t mask);                 /* these counters become 0 */
void ea1_port_timer(uint32_t hz);                 /* calls ea1_on_timer so often; 0 for never */
void ea1_port_send(const uint8_t *bytes, uint8_t length);  /* waits until there is room */

/* What the board calls. */
void ea1_start(struct ea1 *arm);                  /* once, when everything runs */
void ea1_on_timer(struct ea1 *arm);               /* from the timer's interrupt */
void ea1_on_byte(struct ea1 *arm, uint8_t byte);  /* from the main loop, for each byte received */
void ea1_on_idle(struct ea1 *arm);                /* from the main loop, as often as it turns */

#endif
