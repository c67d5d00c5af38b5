/* EA1 for the arm's side: see ../ea1.md. Nothing here knows the board; ea1.h lists what it has to provide. */
#include "ea1.h"

/* ---- lines ---- */

struct line {
    uint8_t bytes[EA1_LONGEST_LINE];
    uint8_t length;
};

static void put(struct line *line, char letter)
{
    /* Five are kept for the end; the longest line that is made here has 117. */
    if (line->length < EA1_LONGEST_LINE - 5)
        line->bytes[line->length++] = (uint8_t)letter;
}

static void put_text(struct line *line, const char *text)
{
    while (*text)
        put(line, *text++);
}

static void put_unsigned(struct line *line, uint32_t value)
{
    char digits[10];
    uint8_t count = 0;
    do {
        digits[count++] = (char)('0' + value % 10);
        value /= 10;
    } while (value);
    put(line, ',');
    while (count)
        put(line, digits[--count]);
}

static void put_signed(struct line *line, int32_t value)
{
    uint32_t magnitude = value < 0 ? 0u - (uint32_t)value : (uint32_t)value;
    uint8_t at = line->length;
    put_unsigned(line, magnitude);
    if (value < 0) {
        /* Between the comma and the digits. */
        uint8_t end = line->length;
        put(line, '-');
        for (; end > at + 1; end--)
            line->bytes[end] = line->bytes[end - 1];
        line->bytes[at + 1] = '-';
    }
}

static char hex_digit(uint8_t value)
{
    return (char)(value < 10 ? '0' + value : 'A' + value - 10);
}

static void begin(struct line *line, const char *kind)
{
    line->length = 0;
    put(line, '$');
    put_text(line, kind);
}

static void end_and_send(struct line *line)
{
    uint8_t sum = 0, at;
    for (at = 1; at < line->length; at++)
        sum ^= line->bytes[at];
    line->bytes[line->length++] = '*';
    line->bytes[line->length++] = (uint8_t)hex_digit(sum >> 4);
    line->bytes[line->length++] = (uint8_t)hex_digit(sum & 15);
    line->bytes[line->length++] = '\r';
    line->bytes[line->length++] = '\n';
    ea1_port_send(line->bytes, line->length);
}

static void send_error(uint32_t code)
{
    struct line line;
    begin(&line, "EE");
    put_unsigned(&line, code);
    end_and_send(&line);
}

static void send_identity(const struct ea1 *arm)
{
    struct line line;
    uint8_t axis;
    begin(&line, "EI,1,");
    put_text(&line, arm->model);
    put(&line, ',');
    put_text(&line, arm->serial);
    put_unsigned(&line, EA1_AXES);
    for (axis = 0; axis < EA1_AXES; axis++)
        put_unsigned(&line, arm->counts_per_turn[axis]);
    put_unsigned(&line, 1000000);
    put_unsigned(&line, arm->rate_hz);
    end_and_send(&line);
}

/* ---- samples ---- */

static void send_line(const struct ea1_latch *latch, uint32_t seq, uint8_t flags)
{
    struct line line;
    uint8_t axis;
    begin(&line, "EA");
    put_unsigned(&line, seq);
    put_unsigned(&line, latch->t_us);
    for (axis = 0; axis < EA1_AXES; axis++)
        put_signed(&line, latch->counts[axis]);
    put(&line, ',');
    put(&line, hex_digit(flags >> 4));
    put(&line, hex_digit(flags & 15));
    end_and_send(&line);
}

static uint8_t put_le(uint8_t *to, uint32_t value, uint8_t bytes)
{
    uint8_t at;
    for (at = 0; at < bytes; at++)
        to[at] = (uint8_t)(value >> (8 * at));
    return bytes;
}

static uint16_t crc16(const uint8_t *bytes, uint8_t length)
{
    uint16_t crc = 0xffff;
    uint8_t bit;
    while (length--) {
        crc ^= (uint16_t)((uint16_t)*bytes++ << 8);
        for (bit = 0; bit < 8; bit++)
            crc = (uint16_t)(crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1);
    }
    return crc;
}

static void send_block(const struct ea1_latch *latch, uint32_t seq, uint8_t flags)
{
    uint8_t plain[EA1_BLOCK - 2], wire[EA1_BLOCK];
    uint8_t length = 0, axis, code = 0, at;
    plain[length++] = 1;
    plain[length++] = EA1_AXES;
    length += put_le(plain + length, flags, 2);
    length += put_le(plain + length, seq, 4);
    length += put_le(plain + length, latch->t_us, 4);
    for (axis = 0; axis < EA1_AXES; axis++)
        length += put_le(plain + length, (uint32_t)latch->counts[axis], 4);
    plain[length++] = latch->buttons;
    length += put_le(plain + length, crc16(plain, length), 2);

    /* COBS: in the place of each zero, and in front, how far the next one is. */
    for (at = 0; at < length; at++) {
        if (plain[at]) {
            wire[at + 1] = plain[at];
        } else {
            wire[code] = (uint8_t)(at + 1 - code);
            code = (uint8_t)(at + 1);
        }
    }
    wire[code] = (uint8_t)(length + 1 - code);
    wire[length + 1] = 0;
    ea1_port_send(wire, EA1_BLOCK);
}

static void send_sample(struct ea1 *arm, const struct ea1_latch *latch, uint32_t seq, uint8_t as_block)
{
    uint8_t flags = (uint8_t)((arm->homed & 7) | (arm->faults & 7) << 3);
    if (latch->buttons)
        flags |= 1 << 6;
    if (arm->overrun) {
        flags |= 1 << 7;
        arm->overrun = 0;
    }
    if (as_block)
        send_block(latch, seq, flags);
    else
        send_line(latch, seq, flags);
}

/* ---- what the board calls ---- */

void ea1_start(struct ea1 *arm)
{
    ea1_port_timer(0);
    send_identity(arm);
}

void ea1_on_timer(struct ea1 *arm)
{
    struct ea1_latch latch = ea1_port_latch();
    arm->seq++;
    arm->faults |= latch.faults & 7;
    if (arm->waiting) {
        arm->overrun = 1;
        return;
    }
    arm->slot = latch;
    arm->slot_seq = arm->seq;
    arm->waiting = 1;
}

void ea1_on_idle(struct ea1 *arm)
{
    if (arm->waiting) {
        /* The slot is ours until waiting is cleared. */
        send_sample(arm, &arm->slot, arm->slot_seq, arm->as_blocks);
        arm->waiting = 0;
    }
}

/* Digits and nothing else, below 2^32: 1 if so. */
static int number(const char *text, uint32_t *value)
{
    uint64_t sum = 0;
    if (!*text)
        return 0;
    for (; *text; text++) {
        if (*text < '0' || *text > '9')
            return 0;
        sum = sum * 10 + (uint64_t)(*text - '0');
        if (sum > 0xffffffffu)
            return 0;
    }
    *value = (uint32_t)sum;
    return 1;
}

static void stream(struct ea1 *arm, uint32_t hz, uint8_t as_blocks)
{
    /* A usual line has 45 bytes. */
    if ((uint64_t)hz * (as_blocks ? EA1_BLOCK : 45) > arm->bytes_per_second) {
        send_error(3);
        return;
    }
    ea1_port_timer(0);
    arm->waiting = 0;
    arm->rate_hz = hz;
    arm->as_blocks = as_blocks;
    ea1_port_timer(hz);
}

static void obey(struct ea1 *arm, const char *command)
{
    uint32_t value = 0, now = ea1_port_us();
    struct line line;
    char letter = command[0] == '!' ? command[1] : 0;
    const char *parameter = letter ? command + 2 : command;
    int bare = letter == 'I' || letter == 'P';
    if (!letter || (!bare && letter != 'R' && letter != 'B' && letter != 'Z' && letter != 'T') || (bare && *parameter)) {
        send_error(1);
    } else if (!bare && (!number(parameter, &value) || (letter == 'Z' && value > 7))) {
        send_error(2);
    } else if (letter == 'I') {
        send_identity(arm);
    } else if (letter == 'P') {
        struct ea1_latch latch;
        /* The timer must not come between the number and the latch; what it left is older and goes first. */
        ea1_port_timer(0);
        ea1_on_idle(arm);
        latch = ea1_port_latch();
        arm->seq++;
        arm->faults |= latch.faults & 7;
        send_sample(arm, &latch, arm->seq, 0);
        ea1_port_timer(arm->rate_hz);
    } else if (letter == 'Z') {
        /* What was latched before is not counted from here. */
        ea1_port_timer(0);
        arm->waiting = 0;
        ea1_port_zero((uint8_t)value);
        ea1_port_timer(arm->rate_hz);
        arm->homed |= (uint8_t)value;
        arm->faults &= (uint8_t)~value;
    } else if (letter == 'T') {
        begin(&line, "ET");
        put_unsigned(&line, value);
        put_unsigned(&line, now);
        end_and_send(&line);
    } else {
        stream(arm, value, letter == 'B');
    }
}

void ea1_on_byte(struct ea1 *arm, uint8_t byte)
{
    const uint8_t room = sizeof arm->command - 1;
    if (byte == '\n') {
        uint8_t length = arm->command_length;
        arm->command_length = 0;
        while (length && length <= room && arm->command[length - 1] == '\r')
            length--;
        if (length > room) {
            send_error(1);
            return;
        }
        arm->command[length] = 0;
        obey(arm, arm->command);
    } else if (arm->command_length < room) {
        arm->command[arm->command_length++] = (char)byte;
    } else {
        /* Too long to be a command: remembered until the line ends. */
        arm->command_length = (uint8_t)(room + 1);
    }
}
