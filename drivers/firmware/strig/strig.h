/* STRIG/2, see ../STRIG.md: the protocol, the contacts' timing and the shaker's, without hardware.
 *
 * A board gives the seven functions below and calls strig_begin once, strig_byte for each byte heard, and strig_poll as
 * often as it can. */
#ifndef STRIG_H
#define STRIG_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define STRIG_FIRMWARE "2.0"

/* the board's part */
uint64_t board_now_us(void);              /* microseconds since power-up */
void board_send(const char *text);        /* to the host; may wait for room, never drops */
void board_shutter(bool closed);          /* the shutter contact */
void board_focus(bool closed);            /* the focus contact */
bool board_flash(void);                   /* whether the hot shoe is closed */
bool board_has_shaker(void);              /* whether there are channels for one */
void board_shaker(uint16_t x, uint16_t y); /* both channels, 12 bits, 2048 at rest */
extern const char board_name[];           /* no spaces */
extern const char board_serial[];         /* no spaces */

/* the protocol's part */
void strig_begin(void);
void strig_byte(char byte);
void strig_poll(void);

#ifdef __cplusplus
}
#endif

#endif
