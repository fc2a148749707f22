/* STRIG/4, see ../STRIG.md. */
#include "strig.h"

#include <string.h>

#define LONGEST 63
#define LONGEST_MS 3600000UL
#define WATCHDOG_US 5000000ULL
#define HEARTBEAT_MS 100UL
#define LONGEST_HEARTBEAT_MS 1000UL
#define MOST_POINTS 128
#define SHORTEST_US 1000UL
#define LONGEST_US 1000000UL
#define FULL 4095
#define REST 2048
#define MOST_SAMPLES_HZ 200

enum phase { IDLE, DELAY, FOCUS, CLOSED };

static char line[LONGEST + 2];
static uint8_t length;
static uint32_t seq;
static enum phase phase;
static uint32_t shot;           /* number of the shot that runs */
static uint64_t focus_at_us;    /* when its contacts move */
static uint64_t close_at_us;
static uint64_t release_at_us;
static uint64_t received_us;       /* last byte from the host */
static bool flash_before;

static bool enabled;            /* the motors are */
static uint32_t hold;           /* number of the command that enabled them last */
static uint64_t due_us;         /* when the next heartbeat is */
static uint64_t released_us;
static bool unreported;         /* the watchdog released them, and the host was not notified */

static uint16_t path[MOST_POINTS][2];
static uint8_t points;          /* of the path */
static uint8_t points_set;      /* how many of them the host has set */
static uint32_t interval_us;
static bool shaking, resting;   /* resting: from the end of this round on */
static uint32_t shake;          /* number of the command that began it */
static uint8_t point;           /* that is put out */
static uint64_t next_us;        /* when the following one is */

static uint32_t sample_interval_us; /* of the inertial unit; 0: it is not read */
static uint64_t sample_us;      /* when it is read next */
static uint8_t checksum;        /* of the line that is being sent */

static void say(const char *text)
{
    for (const char *at = text; *at; at++)
        checksum ^= (uint8_t)*at;
    board_send(text);
}

static void say_hex(uint16_t value, uint8_t digits)
{
    char text[5];
    for (uint8_t i = digits; i > 0; i--, value >>= 4)
        text[i - 1] = "0123456789ABCDEF"[value & 15];
    text[digits] = '\0';
    say(text);
}

/* Every line ends in `*` and the exclusive or of the characters before it. */
static void end_line(void)
{
    uint8_t sum = checksum;
    say("*");
    say_hex(sum, 2);
    say("\n");
    checksum = 0;
}

/* A number in decimal. One 64-bit division splits it; the rest is done in 32 bits, which small cores are quicker at. */
static void send_number(uint64_t number)
{
    uint32_t high = (uint32_t)(number / 1000000000ULL);
    uint32_t low = (uint32_t)(number % 1000000000ULL);
    char text[21];
    char *at = text + sizeof text - 1;
    *at = '\0';
    for (uint8_t i = 0; i < 9 && (high || low || i == 0); i++, low /= 10)
        *--at = (char)('0' + low % 10);
    for (; high; high /= 10)
        *--at = (char)('0' + high % 10);
    say(at);
}

static void send_event(const char *kind, uint32_t number, uint64_t t_us)
{
    say("EVT ");
    say(kind);
    say(" ");
    send_number(number);
    say(" ");
    send_number(t_us);
    end_line();
}

static void send_flash(uint64_t t_us)
{
    say("EVT FLASH ");
    send_number(t_us);
    end_line();
}

static void greet(void)
{
    say("STRIG/4 ");
    say(board_name);
    say(" " STRIG_FIRMWARE " ");
    say(board_serial);
    end_line();
}

static void accept(void)
{
    seq++;
    say("OK ");
    send_number(seq);
    end_line();
}

static void refuse(const char *text)
{
    say("ERR ");
    say(text);
    end_line();
}

static void rest(void)
{
    board_shaker(REST, REST);
    if (shaking) {
        shaking = false;
        send_event("REST", shake, board_now_us());
    }
}

static void release_motors(void)
{
    board_motors(false);
    enabled = false;
    released_us = board_now_us();
}

void strig_watch(void)
{
    if (enabled && board_now_us() >= due_us) {
        release_motors();
        unreported = true;
    }
}

static void report_release(void)
{
    unreported = false;
    send_event("RELEASE", hold, released_us);
}

/* A heartbeat that comes too late finds the motors released. */
static bool take_beat(uint8_t count, const uint32_t *n)
{
    uint32_t ms = count ? n[0] : HEARTBEAT_MS;
    if (ms < 1 || ms > LONGEST_HEARTBEAT_MS)
        return false;
    strig_watch();
    if (enabled)
        due_us = board_now_us() + 1000ULL * ms;
    else
        report_release();
    return true;
}

static void end_shot(const char *kind)
{
    board_shutter(false);
    board_focus(false);
    if (phase != IDLE) {
        uint64_t now_us = board_now_us();
        phase = IDLE;
        send_event(kind, shot, now_us);
    }
}

/* Up to `most` numbers after the command, each preceded by one space; how many there were, or -1. */
static int8_t read_numbers(const char *at, uint32_t *numbers, uint8_t most)
{
    uint8_t count = 0;
    while (*at == ' ') {
        uint32_t value = 0;
        uint8_t digits = 0;
        for (at++; *at >= '0' && *at <= '9' && digits < 8; at++, digits++)
            value = value * 10 + (uint32_t)(*at - '0');
        if (digits == 0 || value > LONGEST_MS || count == most)
            return -1;
        numbers[count++] = value;
    }
    return *at ? -1 : (int8_t)count;
}

static void start_shot(uint32_t delay_ms, uint32_t focus_ms, uint32_t pulse_ms)
{
    accept();
    shot = seq;
    focus_at_us = board_now_us() + 1000ULL * delay_ms;
    close_at_us = focus_at_us + 1000ULL * focus_ms;
    release_at_us = close_at_us + 1000ULL * pulse_ms;
    phase = DELAY;
    strig_poll();
}

static bool take_path(uint8_t count, const uint32_t *n)
{
    if (count != 2 || n[0] < 2 || n[0] > MOST_POINTS || n[1] < SHORTEST_US || n[1] > LONGEST_US)
        return false;
    points = (uint8_t)n[0];
    interval_us = n[1];
    points_set = 0;
    accept();
    return true;
}

static bool take_point(uint8_t count, const uint32_t *n)
{
    if (count != 3 || n[0] > points_set || n[0] >= points || n[1] > FULL || n[2] > FULL)
        return false;
    path[n[0]][0] = (uint16_t)n[1];
    path[n[0]][1] = (uint16_t)n[2];
    if (n[0] == points_set)
        points_set++;
    accept();
    return true;
}

static bool take_shake(uint8_t count, const uint32_t *n)
{
    if (count != 1 || n[0] > 1 || (n[0] == 1 && (points == 0 || points_set < points)))
        return false;
    accept();
    if (n[0] == 0) {
        resting = true;
        return true;
    }
    uint64_t now_us = board_now_us();
    board_shaker(path[0][0], path[0][1]);
    shaking = true;
    resting = false;
    shake = seq;
    point = 0;
    next_us = now_us + interval_us;
    send_event("SHAKE", shake, now_us);
    return true;
}

static bool take_enable(uint8_t count, const uint32_t *n)
{
    if (count != 1 || n[0] > 1)
        return false;
    strig_watch();
    if (unreported)
        report_release();
    accept();
    if (n[0] == 0) {
        if (enabled)
            release_motors();
        return true;
    }
    hold = seq;
    due_us = board_now_us() + 1000ULL * HEARTBEAT_MS;
    enabled = true;
    board_motors(true);
    return true;
}

static bool take_imu(uint8_t count, const uint32_t *n)
{
    if (count != 1 || n[0] > MOST_SAMPLES_HZ)
        return false;
    accept();
    sample_interval_us = n[0] ? 1000000UL / n[0] : 0;
    sample_us = board_now_us() + sample_interval_us;
    return true;
}

static void send_sample(uint64_t now_us)
{
    int16_t reading[6];
    board_imu(reading);
    sample_us += sample_interval_us;
    if (sample_us < now_us) /* something took longer than an interval */
        sample_us = now_us + sample_interval_us;
    say("S ");
    send_number(now_us);
    say(" ");
    for (uint8_t i = 0; i < 6; i++)
        say_hex((uint16_t)reading[i], 4);
    end_line();
}

static bool begins(const char *word)
{
    size_t n = strlen(word);
    return strncmp(line, word, n) == 0 && (line[n] == ' ' || line[n] == '\0');
}

static bool shakes(void)
{
    return begins("PATH") || begins("POINT") || begins("SHAKE");
}

static void act(void)
{
    uint32_t n[3] = {0, 0, 0};
    int8_t count;
    if (begins("FOCUS")) {
        count = read_numbers(line + 5, n, 1);
        if (count == 1 && n[0] <= 1) {
            board_focus(n[0] == 1);
            accept();
            return;
        }
    } else if (begins("SHOT")) {
        count = read_numbers(line + 4, n, 3);
        if (count >= 2 && n[1] > 0) {
            start_shot(n[2], n[0], n[1]);
            return;
        }
    } else if (begins("ENABLE")) {
        count = read_numbers(line + 6, n, 1);
        if (count >= 0 && take_enable((uint8_t)count, n))
            return;
    } else if (begins("BEAT")) {
        count = read_numbers(line + 4, n, 1);
        if (count >= 0 && take_beat((uint8_t)count, n))
            return;
    } else if (begins("IMU")) {
        count = read_numbers(line + 3, n, 1);
        if (count >= 0 && take_imu((uint8_t)count, n))
            return;
    } else if (begins("PATH")) {
        count = read_numbers(line + 4, n, 2);
        if (count >= 0 && take_path((uint8_t)count, n))
            return;
    } else if (begins("POINT")) {
        count = read_numbers(line + 5, n, 3);
        if (count >= 0 && take_point((uint8_t)count, n))
            return;
    } else if (begins("SHAKE")) {
        count = read_numbers(line + 5, n, 1);
        if (count >= 0 && take_shake((uint8_t)count, n))
            return;
    } else {
        count = read_numbers(line + 4, n, 1);
        if (count == 1 && n[0] > 0) {
            start_shot(0, 0, n[0]);
            return;
        }
    }
    refuse("2 bad argument");
}

static void obey(uint64_t arrived_us)
{
    if (strcmp(line, "ID?") == 0) {
        greet();
    } else if (begins("SYNC?")) {
        uint32_t tag = 0;
        int8_t count = read_numbers(line + 5, &tag, 1);
        if (count < 0) {
            refuse("2 bad argument");
            return;
        }
        say("SYNC ");
        send_number(arrived_us);
        if (count) {
            say(" ");
            send_number(tag);
        }
        end_line();
    } else if (strcmp(line, "ABORT") == 0) {
        accept();
        end_shot("ABORT");
        rest();
    } else if (begins("ENABLE") || begins("BEAT")) {
        act();
    } else if (begins("IMU")) {
        if (board_has_imu())
            act();
        else
            refuse("5 no inertial unit");
    } else if (!begins("FOCUS") && !begins("SHOT") && !begins("BULB") && !shakes()) {
        refuse("1 unknown command");
    } else if (shakes() && !board_has_shaker()) {
        refuse("4 no shaker");
    } else if (phase != IDLE || (shaking && shakes() && strcmp(line, "SHAKE 0") != 0)) {
        refuse("3 busy");
    } else {
        act();
    }
}

void strig_begin(void)
{
    length = 0;
    seq = 0;
    phase = IDLE;
    flash_before = false;
    points = points_set = 0;
    sample_interval_us = 0;
    checksum = 0;
    shaking = resting = false;
    enabled = unreported = false;
    hold = 0;
    released_us = 0;
    received_us = board_now_us();
    board_shutter(false);
    board_focus(false);
    board_motors(false);
    board_shaker(REST, REST);
    greet();
}

void strig_byte(char byte)
{
    received_us = board_now_us();
    if (byte == '\r')
        return;
    if (byte != '\n') {
        if (length <= LONGEST)
            line[length++] = byte;
        return;
    }
    line[length] = '\0';
    if (length > LONGEST)
        refuse("2 bad argument");
    else if (length > 0)
        obey(received_us);
    length = 0;
}

void strig_poll(void)
{
    strig_watch();
    if (unreported)
        report_release();
    uint64_t now_us = board_now_us();
    bool flash = board_flash();
    if (flash && !flash_before)
        send_flash(now_us);
    flash_before = flash;
    if (phase == DELAY && now_us >= focus_at_us) {
        board_focus(close_at_us > focus_at_us);
        phase = FOCUS;
    }
    if (phase == FOCUS && now_us >= close_at_us) {
        board_shutter(true);
        phase = CLOSED;
        send_event("SHUTTER", shot, now_us);
    } else if (phase == CLOSED && now_us >= release_at_us) {
        end_shot("DONE");
    } else if (phase == CLOSED && now_us - received_us >= WATCHDOG_US) {
        end_shot("WATCHDOG");
    }
    if (shaking && now_us - received_us >= WATCHDOG_US) {
        rest();
    } else if (shaking && now_us >= next_us) {
        next_us += interval_us;
        point = (uint8_t)(point + 1 == points ? 0 : point + 1);
        if (point == 0 && resting)
            rest();
        else
            board_shaker(path[point][0], path[point][1]);
    }
    if (sample_interval_us && now_us >= sample_us)
        send_sample(now_us);
}
