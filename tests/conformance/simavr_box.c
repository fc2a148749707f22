/* Runs an ATmega328P program in simavr in real time, its UART on a pseudo-terminal whose name is printed. */
#include <simavr/avr_ioport.h>
#include <simavr/parts/uart_pty.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static struct timespec start;

static long long real_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (now.tv_sec - start.tv_sec) * 1000000000LL + now.tv_nsec - start.tv_nsec;
}

static void pace(avr_t *avr, avr_cycle_count_t cycles)
{
    long long ahead = (long long)((avr->cycle + cycles) * 125 / 2) - real_ns(); /* 62.5 ns a cycle */
    if (ahead > 0) {
        struct timespec rest = {ahead / 1000000000LL, ahead % 1000000000LL};
        nanosleep(&rest, NULL);
    }
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware = {{0}};
    uart_pty_t pty;
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    if (argc < 2 || !avr || elf_read_firmware(argv[1], &firmware))
        return 1;
    firmware.frequency = 16000000;
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->sleep = pace;
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), 4), 1); /* nothing on the hot shoe */
    uart_pty_init(avr, &pty);
    uart_pty_connect(&pty, '0');
    printf("%s\n", pty.pty.slavename);
    fflush(stdout);
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (unsigned int steps = 1;; steps++) {
        int state = avr_run(avr);
        if (steps % 4096 == 0) /* programs that never sleep are held back, too */
            pace(avr, 0);
        if (state == cpu_Done || state == cpu_Crashed)
            return 2;
    }
}
