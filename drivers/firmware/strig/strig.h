/* STRIG/3, see ../STRIG.md: the protocol, the timing of contacts, shaker and motor enable, without hardware.
 *
 * A board gives the eight functions below and calls strig_begin once, strig_byte for each byte heard, and strig_poll as
 * often as it can; while board_send waits for room it calls strig_watch. */
#ifndef STRIG_H
#define STRIG_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define STRIG_FIRMWARE "3.0"

/* the board's part */
uint64_t board_now_us(void);              /* microseconds since power-up */
void board_send(const char *text);        /* to the host; may wait for room, never drops */
void board_shutter(bool closed);          /* the shutter contact */
void board_focus(bool closed);            /* the focus contact */
bool board_flash(void);                   /* whether the hot shoe is closed */
bool board_has_shaker(void);              /* whether there are channels for one */
void board_shaker(uint16_t x, uint16_t y); /* both channels, 12 bits, 2048 at rest */
void board_motors(bool enabled);          /* the motor enable output, held only while heartbeats come */
extern const char board_name[];           /* no spaces */
extern const char board_serial[];         /* no spaces */

/* the protocol's part */
void strig_begin(void);
void strig_byte(char byte);
void strig_poll(void);
void strig_watch(void);                   /* release the motors where the heartbeat is late; sends nothing */

#ifdef __cplusplus
}
#endif

#endif
