// STRIG/4 on an Arduino or a Pico (Arduino core): focus contact on pin 3, shutter contact on pin 2, motor enable on pin 5,
// all active high into opto-couplers; a resistor of 10 k against ground keeps the motors off while the board starts. Hot
// shoe on pin 4 against ground. A shaker's two channels are those of an MCP4822 on SPI, its CS on
// pin 10: set HAS_SHAKER where there is one; an inertial unit MPU-6500 on the same SPI, its CS on pin 9: set HAS_IMU.
#include <SPI.h>

#define STRIG_BOARD
#include "strig.h"

const bool HAS_SHAKER = false, HAS_IMU = false;
const int DAC_SELECT = 10, IMU_SELECT = 9;

const int SHUTTER = 2, FOCUS = 3, HOT_SHOE = 4, MOTORS = 5;

#if defined(ARDUINO_ARCH_RP2040)
const char board_name[] = "pico";
#else
const char board_name[] = "arduino";
#endif
const char board_serial[] = "1"; // give each box its own

extern "C" uint64_t board_now_us(void)
{
    static uint32_t before = 0, turns = 0;
    uint32_t now = micros();
    if (now < before)
        turns++; // micros() wraps every 71 minutes; it is read far more often
    before = now;
    return ((uint64_t)turns << 32) | now;
}

// USB of the board itself has no room while nobody reads: that must not hold up the watchdog
extern "C" void board_send(const char *text)
{
    for (; *text; text++) {
        while (Serial.availableForWrite() < 1)
            strig_watch();
        Serial.write(*text);
    }
}

extern "C" void board_shutter(bool closed) { digitalWrite(SHUTTER, closed ? HIGH : LOW); }
extern "C" void board_focus(bool closed) { digitalWrite(FOCUS, closed ? HIGH : LOW); }
extern "C" void board_motors(bool enabled) { digitalWrite(MOTORS, enabled ? HIGH : LOW); }
extern "C" bool board_flash(void) { return digitalRead(HOT_SHOE) == LOW; }

extern "C" bool board_has_shaker(void) { return HAS_SHAKER; }

static void put_out(uint16_t command, uint16_t value)
{
    digitalWrite(DAC_SELECT, LOW);
    SPI.transfer16(command | value);
    digitalWrite(DAC_SELECT, HIGH);
}

extern "C" void board_shaker(uint16_t x, uint16_t y)
{
    if (!HAS_SHAKER)
        return;
    SPI.beginTransaction(SPISettings(8000000, MSBFIRST, SPI_MODE0));
    put_out(0x1000, x); // channel A, full range, switched on (MCP4822 data sheet, register 5-1)
    put_out(0x9000, y);
    SPI.endTransaction();
}

static bool imu_there;

static void choose_imu(bool on)
{
    if (on)
        SPI.beginTransaction(SPISettings(1000000, MSBFIRST, SPI_MODE0));
    digitalWrite(IMU_SELECT, on ? LOW : HIGH);
    if (!on)
        SPI.endTransaction();
}

static uint8_t imu_register(uint8_t address, uint8_t value)
{
    choose_imu(true);
    SPI.transfer(address);
    value = SPI.transfer(value);
    choose_imu(false);
    return value;
}

extern "C" bool board_has_imu(void) { return imu_there; }

extern "C" void board_imu(int16_t reading[6])
{
    choose_imu(true);
    SPI.transfer(0x80 | STRIG_IMU_DATA);
    for (uint8_t i = 0; i < 7; i++) { // the fourth word is a temperature
        int16_t word = (int16_t)SPI.transfer16(0);
        if (i != 3)
            reading[i < 3 ? i : i - 1] = word;
    }
    choose_imu(false);
}

void setup()
{
    if (HAS_SHAKER || HAS_IMU) {
        pinMode(DAC_SELECT, OUTPUT);
        digitalWrite(DAC_SELECT, HIGH);
        pinMode(IMU_SELECT, OUTPUT);
        digitalWrite(IMU_SELECT, HIGH);
        SPI.begin();
    }
    imu_there = HAS_IMU && imu_register(0x80 | STRIG_IMU_WHO, 0) == STRIG_IMU_ANSWER;
    for (uint8_t i = 0; imu_there && i < sizeof strig_imu_setup / 2; i++)
        imu_register(strig_imu_setup[i][0], strig_imu_setup[i][1]);
    pinMode(SHUTTER, OUTPUT);
    pinMode(FOCUS, OUTPUT);
    pinMode(MOTORS, OUTPUT);
    pinMode(HOT_SHOE, INPUT_PULLUP);
    Serial.begin(115200);
    strig_begin();
}

void loop()
{
    while (Serial.available() > 0)
        strig_byte((char)Serial.read());
    strig_poll();
}
