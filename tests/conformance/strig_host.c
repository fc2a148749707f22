/* The firmware's protocol without a board: time is set, what it says and puts out is kept. A test loads it and the twin
 * beside each other. */
#include <string.h>

#include "strig.h"

const char board_name[] = "simulated";
const char board_serial[] = "SIM-1";

static uint64_t now_us;
static char said[1 << 20];
static size_t length;
static bool shaker = true, flash;
static int16_t imu[6];

uint64_t board_now_us(void) { return now_us; }

void board_send(const char *text)
{
    size_t more = strlen(text);
    if (length + more < sizeof said) {
        memcpy(said + length, text, more + 1);
        length += more;
    }
}

bool board_flash(void) { return flash; }
bool board_has_shaker(void) { return shaker; }
bool board_has_imu(void) { return shaker; }
void board_imu(int16_t reading[6]) { memcpy(reading, imu, sizeof imu); }
void host_imu(const int16_t reading[6]) { memcpy(imu, reading, sizeof imu); }

static void keep(const char *what, uint16_t a, uint16_t b)
{
    char line[64];
    size_t at = strlen(what);
    memcpy(line, what, at);
    for (int part = 0; part < 2; part++) {
        uint16_t value = part ? b : a;
        line[at++] = ' ';
        for (uint16_t unit = 1000; unit; unit /= 10)
            line[at++] = (char)('0' + value / unit % 10);
    }
    line[at++] = '\n';
    line[at] = '\0';
    board_send(line);
}

void board_shutter(bool closed) { keep("* shutter", closed, 0); }
void board_focus(bool closed) { (void)closed; }
void board_motors(bool enabled) { keep("* motors", enabled, 0); }
void board_shaker(uint16_t x, uint16_t y) { keep("* shaker", x, y); }

void host_forget(void)
{
    length = 0;
    said[0] = '\0';
}

void host_begin(bool has_shaker)
{
    now_us = 0;
    host_forget();
    shaker = has_shaker;
    flash = false;
    strig_begin();
}

/* Run until then, a step of 50 us at a time as a board would. */
void host_run(uint64_t until_us)
{
    for (; now_us < until_us; now_us += 50)
        strig_poll();
    strig_poll();
}

/* As a board that waits until then for room to send. */
void host_wait(uint64_t until_us)
{
    for (; now_us < until_us; now_us += 50)
        strig_watch();
}

void host_hear(const char *text)
{
    for (; *text; text++)
        strig_byte(*text);
}

const char *host_said(void) { return said; }
