// An Arduino as controller: rig_board.h and normal_force.c lie beside this file, the latter renamed to normal_force.h.
// An AVR board (Uno, Mega) has no float64: values = "float32" in the scene.
#include "normal_force.h"

void setup()
{
    Serial.begin(115200); // baud of the scene
}

void loop()
{
    while (Serial.available()) {
        int n = rig_byte(Serial.read());
        if (n) Serial.write(rig_out, n);
    }
}
