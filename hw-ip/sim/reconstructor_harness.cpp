// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives the reconstructor: commands of 12 words from standard input, points of 12 words to standard output, in order.
//
// Commands, the number in the first word:
//   0 calibration: table, entry, word, value
//   1 settings: paper, single_camera, range_min, range_max, chi2_max
//   2 one clock of inputs: from the low bit up
//       spot_valid, spot_bank, spot_camera, spot_slot (3 bits), spot_laser (10), start, start_bank, lasers (11),
//       whether the points of this start are dropped;
//       then mask_valid (2 bits), mask_bank (2), mask_laser_1 (10), mask_laser_2 (10);
//       then mask_slots_1 (8 bits), mask_slots_2 (8); then 8 words of spot_data
//   3 wait until every laser has its point
//   4 reset
//   5 pause: clocks
// Points: tdata[7], tlast, then the clocks at which the frame was started, at which the last spot and the last mask of its
// bank before that were given, 0 for none, and at which the point was there.
// Arguments: seed, and of 256 clocks how many on average hold inputs back.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>

#include "Vdut.h"
#include "verilated.h"

static uint64_t state;

// xorshift64
static bool stalls(unsigned of_256) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (state & 255) < of_256;
}

struct Frame {
    uint32_t lasers, start, spot, mask;
    bool dropped;
};

int main(int argc, char** argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: %s SEED STALLS\n", argv[0]);
        return 2;
    }
    state = strtoull(argv[1], nullptr, 10) * 2 + 1;
    const unsigned input_stalls = static_cast<unsigned>(atoi(argv[2]));
    const unsigned most_idle_clocks = 100000;

    Vdut dut;
    dut.rst = 1;
    dut.write_valid = 0;
    dut.spot_valid = 0;
    dut.mask_valid = 0;
    dut.start = 0;
    for (int i = 0; i < 4; i++) {
        dut.clk = i & 1;
        dut.eval();
    }

    enum { calibration, settings, inputs, wait, reset, pause };
    std::deque<Frame> frames;
    uint32_t command[12];
    bool pending = fread(command, sizeof command, 1, stdin) == 1;
    // Late enough for the clock 0 to be long ago
    uint32_t clock = 1000, paused = 0;
    uint32_t last_spot[2] = {0, 0}, last_mask[2] = {0, 0};
    unsigned idle = 0;
    while (pending || !frames.empty()) {
        dut.clk = 0;
        dut.rst = 0;
        dut.write_valid = 0;
        dut.spot_valid = 0;
        dut.mask_valid = 0;
        dut.start = 0;
        bool done = false;
        if (pending) switch (command[0]) {
        case calibration:
            dut.write_valid = 1;
            dut.write_table = command[1];
            dut.write_entry = command[2];
            dut.write_word = command[3];
            dut.write_data = command[4];
            done = true;
            break;
        case settings:
            dut.paper = command[1];
            dut.single_camera = command[2];
            dut.range_min = command[3];
            dut.range_max = command[4];
            dut.chi2_max = command[5];
            done = true;
            break;
        case inputs: {
            const uint32_t i = command[1], m = command[2];
            const bool start = i >> 16 & 1;
            if (stalls(input_stalls) || (start && !dut.ready)) break;
            dut.spot_valid = i & 1;
            dut.spot_bank = i >> 1 & 1;
            dut.spot_camera = i >> 2 & 1;
            dut.spot_slot = i >> 3 & 7;
            dut.spot_laser = i >> 6 & 1023;
            memcpy(&dut.spot_data, command + 4, 32);
            dut.mask_valid = m & 3;
            dut.mask_bank = m >> 2 & 3;
            dut.mask_laser_1 = m >> 4 & 1023;
            dut.mask_laser_2 = m >> 14 & 1023;
            dut.mask_slots_1 = command[3] & 255;
            dut.mask_slots_2 = command[3] >> 8 & 255;
            dut.start = start;
            dut.start_bank = i >> 17 & 1;
            dut.lasers = i >> 18 & 2047;
            if (i & 1) last_spot[i >> 1 & 1] = clock;
            if (m & 1) last_mask[m >> 2 & 1] = clock;
            if (m & 2) last_mask[m >> 3 & 1] = clock;
            if (start) {
                const unsigned bank = i >> 17 & 1;
                frames.push_back({i >> 18 & 2047, clock, last_spot[bank], last_mask[bank], (i >> 29 & 1) != 0});
            }
            done = true;
            break;
        }
        case wait:
            done = frames.empty();
            break;
        case reset:
            dut.rst = 1;
            frames.clear();
            for (int i = 0; i < 2; i++) last_spot[i] = last_mask[i] = 0;
            done = true;
            break;
        case pause:
            done = ++paused > command[1];
            break;
        default:
            fprintf(stderr, "no such command\n");
            return 2;
        }
        dut.eval();
        if (dut.m_axis_tvalid && !dut.rst) {
            if (frames.empty()) {
                fprintf(stderr, "a point without a laser\n");
                return 1;
            }
            Frame& frame = frames.front();
            if (!dut.busy) {
                fprintf(stderr, "a point, but not busy\n");
                return 1;
            }
            uint32_t point[12];
            memcpy(point, &dut.m_axis_tdata, 28);
            point[7] = dut.m_axis_tlast;
            point[8] = frame.start;
            point[9] = frame.spot;
            point[10] = frame.mask;
            point[11] = clock;
            if (!frame.dropped) fwrite(point, sizeof point, 1, stdout);
            if (--frame.lasers == 0) frames.pop_front();
            idle = 0;
        } else if (++idle > most_idle_clocks && !frames.empty()) {
            fprintf(stderr, "no point for %u clocks\n", idle);
            return 1;
        }
        dut.clk = 1;
        dut.eval();
        clock++;
        if (done) {
            paused = 0;
            pending = fread(command, sizeof command, 1, stdin) == 1;
        }
    }
    return 0;
}
