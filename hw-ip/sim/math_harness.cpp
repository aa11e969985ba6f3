// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives one math block (math_blocks.vhd): operands of 24 bytes from standard input, results of 8 bytes to standard
// output, in order. Arguments: seed, and of 256 clocks how many on average hold the input back, and the output.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

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
    if (argc != 4) {
        fprintf(stderr, "usage: %s SEED INPUT_STALLS OUTPUT_STALLS\n", argv[0]);
        return 2;
    }
    state = strtoull(argv[1], nullptr, 10) * 2 + 1;
    const unsigned input_stalls = static_cast<unsigned>(atoi(argv[2]));
    const unsigned output_stalls = static_cast<unsigned>(atoi(argv[3]));
    const unsigned most_clocks_without_result = 100000;

    Vdut dut;
    dut.rst = 1;
    dut.in_valid = 0;
    dut.out_ready = 0;
    for (int i = 0; i < 4; i++) {
        dut.clk = i & 1;
        dut.eval();
    }
    dut.rst = 0;

    uint32_t operands[6];
    bool pending = fread(operands, sizeof operands, 1, stdin) == 1;
    uint64_t taken = 0, given = 0;
    unsigned idle = 0;
    bool offered = false;
    while (pending || given < taken) {
        dut.clk = 0;
        // What is offered stays until it is taken
        offered = pending && (offered || !stalls(input_stalls));
        dut.in_valid = offered;
        if (offered) memcpy(&dut.in_data, operands, sizeof operands);
        dut.out_ready = !stalls(output_stalls);
        dut.eval();
        const bool take = dut.in_valid && dut.in_ready;
        const bool give = dut.out_valid && dut.out_ready;
        const uint64_t result = dut.out_data;
        dut.clk = 1;
        dut.eval();
        if (take) {
            taken++;
            offered = false;
            pending = fread(operands, sizeof operands, 1, stdin) == 1;
        }
        if (give) {
            given++;
            idle = 0;
            fwrite(&result, sizeof result, 1, stdout);
        } else if (++idle > most_clocks_without_result) {
            fprintf(stderr, "no result for %u clocks\n", idle);
            return 1;
        }
        if (given > taken) {
            fprintf(stderr, "more results than operands\n");
            return 1;
        }
    }
    return 0;
}
