/* Runs GRBL for an ATmega328P in simavr, with three axes that have switches at TOP steps:

       grbl_box FIRMWARE TOP            in real time, its UART on a pseudo-terminal whose name is printed
       grbl_box FIRMWARE TOP lockstep   as fast as it goes: "send HEX" gives it bytes, "run MS" lets that time pass and
                                        prints in hex what it said, "where" prints the steps of each axis; nothing
                                        depends on how busy the machine is

   Standard input also does what a person would: "switch X 1", "hold 1", "power": off and on, which leaves the axes where
   they stand and the settings in their EEPROM. Pins are those of an Uno with a variable
   spindle: steps on D2 to D4, directions on D5 to D7, switches on B1, B2 and B4, feed hold on C1. */
#include <fcntl.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/parts/uart_pty.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define AXES 3
#define MEMORY 0x900 /* registers, their images and RAM of an ATmega328P */
#define LOOP 512     /* instructions, more than GRBL's main loop has */
static const char letters[] = "XYZ";
static const int switch_pin[AXES] = {1, 2, 4};
static long place[AXES], top; /* steps from the start; the switch closes at `top` and above */
static int pressed[AXES], backwards[AXES];
static avr_irq_t *switch_irq[AXES];
static unsigned char said[65536];
static size_t said_bytes;
static struct timespec start;
static avr_t *avr;

static void set_switch(int axis)
{
    avr_raise_irq(switch_irq[axis], !(pressed[axis] || place[axis] >= top)); /* a closed switch pulls its pin low */
}

static void hear_direction(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    backwards[(long)param] = value != 0;
}

static void hear_step(struct avr_irq_t *irq, uint32_t value, void *param)
{
    long axis = (long)param;
    (void)irq;
    if (value) {
        place[axis] += backwards[axis] ? -1 : 1;
        set_switch(axis);
    }
}

static void pace(avr_t *avr, avr_cycle_count_t cycles)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    long long real = (now.tv_sec - start.tv_sec) * 1000000000LL + now.tv_nsec - start.tv_nsec;
    long long ahead = (long long)((avr->cycle + cycles) * 125 / 2) - real; /* 62.5 ns a cycle */
    if (ahead > 0) {
        struct timespec rest = {ahead / 1000000000LL, ahead % 1000000000LL};
        nanosleep(&rest, NULL);
    }
}

static void set_pin(avr_irq_t *pin, int high) /* also where it had that level before a reset */
{
    avr_raise_irq(pin, !high);
    avr_raise_irq(pin, high);
}

static void switch_on(void)
{
    avr_reset(avr);
    for (int number = 0; number < 2; number++) /* unused, on step pins: simavr would test their level in every cycle */
        avr_extint_set_strict_lvl_trig(avr, number, 0);
    /* OCR1A: simavr never runs a timer whose top is 0, which an ATmega's is after a reset */
    avr->data[0x88] = avr->data[0x89] = 255;
    for (int axis = 0; axis < AXES; axis++)
        set_pin(switch_irq[axis], !(pressed[axis] || place[axis] >= top));
    for (int pin = 0; pin < 6; pin++) /* nobody presses a button, no probe touches */
        set_pin(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), pin), 1);
}

static void obey(const char *line)
{
    char letter;
    int on;
    if (sscanf(line, "switch %c %d", &letter, &on) == 2 && strchr(letters, letter)) {
        int axis = strchr(letters, letter) - letters;
        pressed[axis] = on;
        set_switch(axis);
    } else if (sscanf(line, "hold %d", &on) == 1) {
        avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('C'), 1), !on);
    } else if (!strncmp(line, "power", 5)) {
        switch_on();
    }
}

static void hear_person(void)
{
    char line[64];
    ssize_t got = read(0, line, sizeof line - 1);
    if (got > 0) {
        line[got] = 0;
        obey(line);
    }
}

static void hear_byte(struct avr_irq_t *irq, uint32_t value, void *param)
{
    (void)irq;
    (void)param;
    if (said_bytes < sizeof said)
        said[said_bytes++] = value;
}

/* A waiting program repeats a loop that returns to the same state, which only a timer or a received byte ends. Such loops
   are skipped as a whole, so every event keeps its clock cycle. */
static struct {
    avr_flashaddr_t pc;
    avr_cycle_count_t cycle;
    uint8_t sreg[8], data[MEMORY];
} snapshot;
static unsigned int instructions, patience; /* since the program last waited; until another place is tried */

static void take_snapshot(void)
{
    snapshot.pc = avr->pc;
    snapshot.cycle = avr->cycle;
    memcpy(snapshot.sreg, avr->sreg, sizeof snapshot.sreg);
    memcpy(snapshot.data, avr->data, sizeof snapshot.data);
}

static int is_unchanged(void)
{
    return !avr->interrupt_state && !memcmp(snapshot.sreg, avr->sreg, sizeof snapshot.sreg) &&
           !memcmp(snapshot.data, avr->data, sizeof snapshot.data);
}

static void skip_loops(avr_cycle_count_t end)
{
    avr_cycle_timer_slot_p timer = avr->cycle_timers.timer;
    avr_cycle_count_t loop = avr->cycle - snapshot.cycle, next = timer && timer->when < end ? timer->when : end;
    if (next > avr->cycle)
        avr->cycle += (next - avr->cycle - 1) / loop * loop;
    snapshot.cycle = avr->cycle;
}

static void run_for(double ms)
{
    avr_cycle_count_t end = avr->cycle + (avr_cycle_count_t)(ms * 16000);
    take_snapshot();
    while (avr->cycle < end) {
        avr_run(avr);
        int returned = avr->pc == snapshot.pc;
        instructions++;
        if (returned && is_unchanged()) {
            skip_loops(end);
            instructions = 0;
            patience = 100 * LOOP;
        } else if (returned) {
            take_snapshot();
        } else if (instructions > patience) {
            take_snapshot();
            instructions = 0;
            patience = LOOP;
        }
    }
}

static int lockstep(void)
{
    char line[4096];
    double ms;
    unsigned int byte;
    uint32_t flags = 0;
    avr_irq_t *input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), hear_byte, NULL);
    avr_ioctl(avr, AVR_IOCTL_UART_GET_FLAGS('0'), &flags);
    flags &= ~(AVR_UART_FLAG_STDIO | AVR_UART_FLAG_POLL_SLEEP);
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    while (fgets(line, sizeof line, stdin)) {
        if (!strncmp(line, "send ", 5)) {
            for (const char *hex = line + 5; sscanf(hex, "%2x", &byte) == 1; hex += 2) {
                avr_raise_irq(input, byte);
                run_for(10 / 115.2); /* a start bit, eight bits, a stop bit */
            }
        } else if (sscanf(line, "run %lf", &ms) == 1) {
            run_for(ms);
            printf("said ");
            for (size_t i = 0; i < said_bytes; i++)
                printf("%02x", said[i]);
            printf("\n");
            said_bytes = 0;
            fflush(stdout);
        } else if (!strncmp(line, "where", 5)) {
            printf("at %ld %ld %ld\n", place[0], place[1], place[2]);
            fflush(stdout);
        } else {
            obey(line);
        }
    }
    return 0;
}

static void rest(avr_t *avr, avr_cycle_count_t cycles)
{
    (void)avr;
    (void)cycles;
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware = {{0}};
    uart_pty_t pty;
    avr = avr_make_mcu_by_name("atmega328p");
    if (argc < 3 || !avr || elf_read_firmware(argv[1], &firmware))
        return 1;
    top = atol(argv[2]);
    firmware.frequency = 16000000;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->sleep = pace;
    for (long axis = 0; axis < AXES; axis++) {
        switch_irq[axis] = avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), switch_pin[axis]);
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 2 + axis), hear_step, (void *)axis);
        avr_irq_register_notify(
            avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 5 + axis), hear_direction, (void *)axis);
    }
    switch_on();
    if (argc > 3) {
        avr->sleep = rest;
        avr->run_cycle_limit = 1; /* one instruction at a time */
        return lockstep();
    }
    uart_pty_init(avr, &pty);
    uart_pty_connect(&pty, '0');
    printf("%s\n", pty.pty.slavename);
    fflush(stdout);
    fcntl(0, F_SETFL, O_NONBLOCK);
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (unsigned int steps = 1;; steps++) {
        int state = avr_run(avr);
        if (steps % 4096 == 0) {
            pace(avr, 0); /* programs that never sleep are held back, too */
            hear_person();
        }
        if (state == cpu_Done || state == cpu_Crashed)
            return 2;
    }
}
