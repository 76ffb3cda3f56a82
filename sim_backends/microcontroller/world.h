/* The physical world of a simulated microcontroller: servos, feedback pots, latches, supply, emergency stop.
 *
 * It moves in steps of 1 ms and depends on nothing but what it is told and when: the same inputs, the same world.
 * Times are microseconds since the emulator started; they go on through resets of the microcontroller.
 */
#ifndef ORI_WORLD_H
#define ORI_WORLD_H

#include <stdbool.h>
#include <stdint.h>

#define WORLD_OUTPUTS 12
#define WORLD_HINGES 12
#define WORLD_LATCHES 8
#define WORLD_MAGNETS 8
#define WORLD_SENSORS 8
#define WORLD_ADC_INPUTS 16
#define WORLD_STEP_US 1000U
#define WORLD_PLANT_US 4000U /* between two questions to a plant: each is two changes of process */
#define WORLD_NOBODY 255

typedef enum { WIRE_GOOD, WIRE_OPEN, WIRE_SHORT } wire_t;
typedef enum { SENSOR_GOOD, SENSOR_LOW, SENSOR_HIGH, SENSOR_BOUNCES } sensor_fault_t;
typedef enum { LATCH_MAGNET, LATCH_ELECTROMAGNET, LATCH_LOCK_PIN } latch_kind_t;

typedef struct {
    bool present, jammed;
    int output, adc; /* WORLD_NOBODY: not wired */
    double position_rad, zero_ns, slope_ns;
    double crease_rad; /* where its crease is, as a shaft position; of a plant, else it is where the shaft is */
    double feedback_zero_urad, feedback_slope_nrad, noise_counts;
    double time_constant_s, max_velocity_rad_s, lower_rad, upper_rad;
    wire_t wire;
} hinge_t;

typedef struct {
    bool present, sensor_high, closed, stuck;
    latch_kind_t kind;
    int output, sensor;
    double engaged_ns, released_ns, travel_s;
    double travel; /* of a lock pin: 0 released, 1 home */
    double energised_s; /* of an electromagnet, summed up */
    bool secures[WORLD_HINGES];
    double closed_rad[WORLD_HINGES], range_rad[WORLD_HINGES];
} latch_t;

typedef struct {
    uint64_t seed, now_us;
    int plant_fd; /* socket of whoever reckons with what the servos drive; -1: nobody */
    double supply_uv, supply_uv_per_count;
    int thermistor_count;
    bool estop;
    hinge_t hinge[WORLD_HINGES];
    latch_t latch[WORLD_LATCHES];
    bool magnet[WORLD_MAGNETS];
    sensor_fault_t sensor_fault[WORLD_SENSORS];
    int adc_forced[WORLD_ADC_INPUTS]; /* -1: not forced */
    struct {
        double width_ns;
        uint64_t at_us;
        bool ever;
    } pulse[WORLD_OUTPUTS];
} world_t;

extern world_t world;

/* An empty world: nothing wired, supply 6 V. */
void world_clear(void);

/* Reads lines of "KEY VALUE" and "hinge K KEY VALUE" as the Python side writes them; false and `wrong` else. */
bool world_read(const char *path, char *wrong, int wrong_size);

/* Puts latches where the positions and their travel leave them; after reading. */
void world_settle(void);

void world_step(uint64_t now_us);
void world_pulse(int output, double width_ns, uint64_t now_us);
void world_magnet(int output, bool on);
uint16_t world_adc(int input);
uint8_t world_sensors(void);
bool world_estop(void);

/* Turns a shaft by hand; what a closed latch holds stays within its grip. */
void world_push(int hinge, double by_rad);

/* A number in [0, 1) for each key, the same for the same seed. */
double world_random(uint64_t key);

#endif
