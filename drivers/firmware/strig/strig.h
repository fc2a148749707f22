/* STRIG/4, see ../STRIG.md: the protocol, the timing of contacts, shaker, inertial samples and motor enable, without hardware.
 *
 * A board gives the ten functions below and calls strig_begin once, strig_byte for each byte received, and strig_poll as
 * often as it can; while board_send waits for room it calls strig_watch. */
#ifndef STRIG_H
#define STRIG_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define STRIG_FIRMWARE "4.0"

/* An MPU-6500 (register map of its maker): wake up, 250 Hz of bandwidth for rates, 500 deg/s, 8 g, 460 Hz for accelerations. */
#define STRIG_IMU_WHO 0x75
#define STRIG_IMU_ANSWER 0x70
#define STRIG_IMU_DATA 0x3B
#ifdef STRIG_BOARD
static const uint8_t strig_imu_setup[][2] = {
    {0x6B, 0x01}, {0x6A, 0x10}, {0x1A, 0x00}, {0x1B, 0x08}, {0x1C, 0x10}, {0x1D, 0x00}};
#endif

/* the board's part */
uint64_t board_now_us(void);              /* microseconds since power-up */
void board_send(const char *text);        /* to the host; may wait for room, never drops */
void board_shutter(bool closed);          /* the shutter contact */
void board_focus(bool closed);            /* the focus contact */
bool board_flash(void);                   /* whether the hot shoe is closed */
bool board_has_shaker(void);              /* whether there are channels for one */
void board_shaker(uint16_t x, uint16_t y); /* both channels, 12 bits, 2048 at rest */
bool board_has_imu(void);                 /* whether there is an inertial unit */
void board_imu(int16_t reading[6]);       /* three accelerations, three rotation rates, now */
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
