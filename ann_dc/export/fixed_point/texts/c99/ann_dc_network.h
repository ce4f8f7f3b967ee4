/* @title@: a network in integers of @bits@ bits, without floating point.
   Written by ann_dc; wiring @wiring@, content @content@.
   Word ranges were chosen for @covers@. */
#ifndef ANN_DC_NETWORK_H
#define ANN_DC_NETWORK_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
    ANN_DC_BITS = @bits@,         /* of an input and of a control */
    ANN_DC_GUARD = @guard@,        /* fraction bits of a word beyond theirs */
    ANN_DC_PERIOD = @period@,       /* steps between two looks at whether words still move */
    ANN_DC_STAGES = @stages@,
    ANN_DC_INPUTS = @inputs@,
    ANN_DC_CONTROLS = @controls@,
    ANN_DC_NEURONS = @neurons@,
    ANN_DC_WORDS = @words@,
    ANN_DC_STEPS = @steps@,        /* until it settles, as it was exported */
    ANN_DC_LIMIT = @limit@         /* steps after which a run that has not settled will not */
};

/* Status. Controls are an answer in ANN_DC_SETTLED alone. */
enum {
    ANN_DC_RUNNING = 0,
    ANN_DC_SETTLED = 1,      /* still, residual small, nothing cut off */
    ANN_DC_SATURATED = 2,    /* a number did not fit since the start: inputs out of range */
    ANN_DC_LIMITED = 3       /* ann_dc_settle took as many steps as it may */
};

/* Inputs: numbers with fraction bits as in README.md, and the values that they hold. */
@input_names@

/* Controls, stage by stage. */
@control_names@

typedef struct {
    int32_t words[ANN_DC_WORDS];
    int32_t marks[ANN_DC_NEURONS];
    uint32_t steps;
    int saturated;           /* stays set until ann_dc_start */
    int status;
} ann_dc_network;

/* The start, with the inputs that the network was exported with. */
void ann_dc_start(ann_dc_network *network);

/* Write a number into an input at a stage; 0 if there is no such place. A number that does not fit
   into ANN_DC_BITS bits is cut off, and saturates: pass it as it is, without a cast to int32_t. The
   status becomes ANN_DC_RUNNING, unless saturated. */
int ann_dc_load(ann_dc_network *network, int input, int stage, int64_t number);

/* A number into an input at all stages. */
int ann_dc_load_all(ann_dc_network *network, int input, int64_t number);

/* One step; 1 if the network is settled after it. */
int ann_dc_step(ann_dc_network *network);

/* Steps until it is settled, at most so many; how many were taken. */
uint32_t ann_dc_settle(ann_dc_network *network, uint32_t limit);

/* ANN_DC_RUNNING, ANN_DC_SETTLED, ANN_DC_SATURATED or ANN_DC_LIMITED. */
int ann_dc_status(const ann_dc_network *network);

/* The number of a control; 0 if there is none. */
int32_t ann_dc_control(const ann_dc_network *network, int control);

#ifdef __cplusplus
}
#endif

#endif
