// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives the reconstructor: commands of 8 words from standard input, points of 10 words to standard output, in order.
// Commands: 0 table entry word value: write a calibration word; 1 paper single_camera range_min range_max chi2_max:
// settings; 2 last tdata[6]: a spot; 3: wait until every laser has its point. Points: tdata[7], then the clocks at which
// the laser's first spot was taken, its last spot was taken, and the point was there. Arguments: seed, and of 256 clocks
// how many on average hold a spot back.

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

int main(int argc, char** argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: %s SEED STALLS\n", argv[0]);
        return 2;
    }
    state = strtoull(argv[1], nullptr, 10) * 2 + 1;
    const unsigned spot_stalls = static_cast<unsigned>(atoi(argv[2]));
    const unsigned most_idle_clocks = 100000;

    Vdut dut;
    dut.rst = 1;
    dut.write_valid = 0;
    dut.s_axis_tvalid = 0;
    for (int i = 0; i < 4; i++) {
        dut.clk = i & 1;
        dut.eval();
    }
    dut.rst = 0;

    enum { write_word, settings, spot, wait };
    struct Taken { uint32_t first, last; };
    std::deque<Taken> under_way;
    uint32_t command[8];
    bool pending = fread(command, sizeof command, 1, stdin) == 1;
    bool offered = false, in_laser = false;
    uint32_t clock = 0, first = 0;
    unsigned idle = 0;
    while (pending || !under_way.empty()) {
        dut.clk = 0;
        dut.write_valid = 0;
        dut.s_axis_tvalid = 0;
        bool done = false;
        if (pending && command[0] == write_word) {
            dut.write_valid = 1;
            dut.write_table = command[1];
            dut.write_entry = command[2];
            dut.write_word = command[3];
            dut.write_data = command[4];
            done = true;
        } else if (pending && command[0] == settings) {
            dut.paper = command[1];
            dut.single_camera = command[2];
            dut.range_min = command[3];
            dut.range_max = command[4];
            dut.chi2_max = command[5];
            done = true;
        } else if (pending && command[0] == spot) {
            // What is offered stays until it is taken
            offered = offered || !stalls(spot_stalls);
            dut.s_axis_tvalid = offered;
            dut.s_axis_tlast = command[1];
            memcpy(&dut.s_axis_tdata, command + 2, 24);
        } else if (pending) {
            done = under_way.empty();
        }
        dut.eval();
        if (dut.s_axis_tvalid && dut.s_axis_tready) {
            offered = false;
            done = true;
            if (!in_laser) first = clock;
            in_laser = !command[1];
            if (command[1]) under_way.push_back({first, clock});
        }
        if (dut.m_axis_tvalid) {
            if (under_way.empty()) {
                fprintf(stderr, "a point without a laser\n");
                return 1;
            }
            uint32_t point[10];
            memcpy(point, &dut.m_axis_tdata, 28);
            point[7] = under_way.front().first;
            point[8] = under_way.front().last;
            point[9] = clock;
            under_way.pop_front();
            fwrite(point, sizeof point, 1, stdout);
            idle = 0;
        } else if (++idle > most_idle_clocks && !under_way.empty()) {
            fprintf(stderr, "no point for %u clocks\n", idle);
            return 1;
        }
        dut.clk = 1;
        dut.eval();
        clock++;
        if (done) pending = fread(command, sizeof command, 1, stdin) == 1;
    }
    return 0;
}
