/* STRIG/4 on a bare ATmega328P at 16 MHz, without the Arduino core: shutter on PD2, focus on PD3, motor enable on PD5,
 * hot shoe on PD4 against ground; a shaker is on an MCP4822 on SPI (PB3, PB5), its CS on PB2;
 * an inertial unit MPU-6500 on the same SPI (PB4, too), its CS on PB1.
 * Build: avr-gcc -mmcu=atmega328p -Os -I../strig main.c ../strig/strig.c -o strig.elf */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#define STRIG_BOARD
#include "strig.h"

#define SHUTTER _BV(PD2)
#define FOCUS _BV(PD3)
#define HOT_SHOE _BV(PD4)
#define MOTORS _BV(PD5)
#define DAC_SELECT _BV(PB2)
#define IMU_SELECT _BV(PB1)
#define RING 128 /* a power of two */

const char board_name[] = "atmega328p";
const char board_serial[] = "1";

static volatile uint8_t rx[RING], rx_in, rx_out;
static volatile uint8_t tx[RING], tx_in, tx_out;
static volatile uint32_t turns; /* of timer 1, 32.768 ms each */

ISR(TIMER1_OVF_vect) { turns++; }
EMPTY_INTERRUPT(TIMER2_COMPA_vect) /* only to wake the main loop, every 128 us */

ISR(USART_RX_vect)
{
    uint8_t byte = UDR0;
    if ((uint8_t)(rx_in - rx_out) < RING)
        rx[rx_in++ % RING] = byte;
}

ISR(USART_UDRE_vect)
{
    if (tx_in == tx_out)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    else
        UDR0 = tx[tx_out++ % RING];
}

uint64_t board_now_us(void)
{
    uint8_t before = SREG;
    cli();
    uint16_t half_us = TCNT1;
    uint32_t high = turns;
    if ((TIFR1 & _BV(TOV1)) && half_us < 0x8000) /* it has just turned over, and the interrupt waits for us */
        high++;
    SREG = before;
    return (((uint64_t)high << 16) | half_us) / 2;
}

void board_send(const char *text)
{
    for (; *text; text++) {
        while ((uint8_t)(tx_in - tx_out) >= RING)
            strig_watch();
        tx[tx_in % RING] = (uint8_t)*text;
        tx_in++;
        UCSR0B |= _BV(UDRIE0);
    }
}

void board_shutter(bool closed)
{
    if (closed)
        PORTD |= SHUTTER;
    else
        PORTD &= (uint8_t)~SHUTTER;
}

void board_focus(bool closed)
{
    if (closed)
        PORTD |= FOCUS;
    else
        PORTD &= (uint8_t)~FOCUS;
}

void board_motors(bool enabled)
{
    if (enabled)
        PORTD |= MOTORS;
    else
        PORTD &= (uint8_t)~MOTORS;
}

bool board_flash(void) { return !(PIND & HOT_SHOE); }

bool board_has_shaker(void) { return true; }

static uint8_t exchange(uint8_t byte)
{
    SPDR = byte;
    while (!(SPSR & _BV(SPIF)))
        ;
    return SPDR;
}

static void put_out(uint16_t word)
{
    PORTB &= (uint8_t)~DAC_SELECT;
    exchange((uint8_t)(word >> 8));
    exchange((uint8_t)word);
    PORTB |= DAC_SELECT;
}

static uint8_t imu_register(uint8_t address, uint8_t value)
{
    PORTB &= (uint8_t)~IMU_SELECT;
    exchange(address);
    value = exchange(value);
    PORTB |= IMU_SELECT;
    return value;
}

static bool imu_there;

static void begin_imu(void)
{
    imu_there = imu_register(0x80 | STRIG_IMU_WHO, 0) == STRIG_IMU_ANSWER;
    for (uint8_t i = 0; imu_there && i < sizeof strig_imu_setup / 2; i++)
        imu_register(strig_imu_setup[i][0], strig_imu_setup[i][1]);
}

bool board_has_imu(void) { return imu_there; }

void board_imu(int16_t reading[6])
{
    PORTB &= (uint8_t)~IMU_SELECT;
    exchange(0x80 | STRIG_IMU_DATA);
    for (uint8_t i = 0; i < 7; i++) { /* the fourth word is a temperature */
        uint16_t word = (uint16_t)(exchange(0) << 8);
        word |= exchange(0);
        if (i != 3)
            reading[i < 3 ? i : i - 1] = (int16_t)word;
    }
    PORTB |= IMU_SELECT;
}

void board_shaker(uint16_t x, uint16_t y)
{
    put_out(0x1000 | x); /* channel A, full range, switched on (MCP4822 data sheet, register 5-1) */
    put_out(0x9000 | y);
}

int main(void)
{
    DDRD = SHUTTER | FOCUS | MOTORS;
    PORTD = HOT_SHOE;                             /* pull-up */
    DDRB = DAC_SELECT | IMU_SELECT | _BV(PB3) | _BV(PB5);
    PORTB = DAC_SELECT | IMU_SELECT;
    SPCR = _BV(SPE) | _BV(MSTR) | _BV(SPR0);      /* 1 MHz, the unit's fastest for its registers */
    UBRR0 = 16;                                   /* 115200 baud, 2.1 % fast */
    UCSR0A = _BV(U2X0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    TCCR1B = _BV(CS11);                           /* 2 MHz */
    TIMSK1 = _BV(TOIE1);
    TCCR2A = _BV(WGM21);
    TCCR2B = _BV(CS22);                           /* 250 kHz, compare every 32 */
    OCR2A = 31;
    TIMSK2 = _BV(OCIE2A);
    sei();
    begin_imu();
    strig_begin();
    for (;;) {
        while (rx_in != rx_out)
            strig_byte((char)rx[rx_out++ % RING]);
        strig_poll();
        sleep_mode();
    }
}
