// A computer in place of an Arduino: its Serial is the end of a pseudo terminal.   arduino serial LINK
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

static struct {
    int file;
    uint8_t byte;
    void begin(long) {}
    int available() { return ::read(file, &byte, 1) == 1; }
    int read() { return byte; }
    void write(const uint8_t *data, int n) { if (::write(file, data, n) != n) exit(1); }
} Serial;

#include "rig_board.ino"

int main(int n, char **given)
{
    termios raw;
    int port;
    if (n != 3) return 2;
    Serial.file = posix_openpt(O_RDWR | O_NOCTTY);
    if (Serial.file < 0 || grantpt(Serial.file) || unlockpt(Serial.file)) return 1;
    port = open(ptsname(Serial.file), O_RDWR | O_NOCTTY); // stays open: this end works without anybody at the other
    tcgetattr(port, &raw);
    cfmakeraw(&raw);
    tcsetattr(port, TCSANOW, &raw);
    if (symlink(ptsname(Serial.file), given[2])) return 1;
    setup();
    puts("ready");
    fflush(stdout);
    for (;;) loop();
}
