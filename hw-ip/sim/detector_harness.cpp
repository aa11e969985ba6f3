// SPDX-License-Identifier: MIT OR Apache-2.0
//
// Drives the detector. Standard input: the configuration (CONFIG_WORDS words of 32 bits, then the azimuth of each laser as
// one more), then beats: a byte of flags (1: tuser, 2: tlast) and the pixels' bytes. Standard output, in the order of time:
// per record of the result stream its 32 bytes, its tlast, and two clocks of 64 bits: its own, and that of the last beat
// taken; per early record the same with EARLY + slot in place of tlast; per laser's slots the laser, the slots, mask_last
// and zero, 64 bits each, with MASK in place of tlast; at the end one record with the counts of the events. Arguments:
// seed; of 256 clocks how many on average hold the input back, and the output; most idle clocks after a row; how many frames
// there are: when all have been given it is over soon. The file is compiled for PPC pixels per clock.

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "Vdut.h"
#include "verilated.h"

static uint64_t state;

// xorshift64
static uint64_t random_bits() {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state >> 8;
}

static bool stalls(unsigned of_256) { return (random_bits() & 255) < of_256; }

struct Beat {
    uint8_t flags;
    uint8_t data[3 * PPC];
};

struct Record {
    uint8_t data[32];
    uint64_t last;
    uint64_t clock;
    uint64_t clock_of_last_beat;
};

enum { CONFIG_WORDS = 21, COUNTS = 2, MASK = 3, EARLY = 16 };

static Vdut dut;
static uint64_t clocks;

static void tick() {
    dut.clk = 1;
    dut.eval();
    dut.clk = 0;
    dut.eval();
    clocks++;
}

int main(int argc, char** argv) {
    if (argc != 6) {
        fprintf(stderr, "usage: %s SEED INPUT_STALLS OUTPUT_STALLS BLANKING FRAMES\n", argv[0]);
        return 2;
    }
    state = strtoull(argv[1], nullptr, 10) * 2 + 1;
    const unsigned input_stalls = static_cast<unsigned>(atoi(argv[2]));
    const unsigned output_stalls = static_cast<unsigned>(atoi(argv[3]));
    const unsigned most_blanking = static_cast<unsigned>(atoi(argv[4]));
    unsigned long frames_left = strtoul(argv[5], nullptr, 10);
    // Longer than the buffers take to empty when every hit is a run of its own; behind the last frame nothing may come
    const unsigned clocks_to_drain = 300000, clocks_behind = 1000;

    uint32_t config[CONFIG_WORDS];
    if (fread(config, sizeof config, 1, stdin) != 1) {
        fprintf(stderr, "no configuration\n");
        return 1;
    }
    int next = 0;
    dut.cfg_width = config[next++];
    dut.cfg_height = config[next++];
    dut.cfg_green_min_0 = config[next++];
    dut.cfg_green_min_1 = config[next++];
    dut.cfg_excess_min_0 = config[next++];
    dut.cfg_excess_min_1 = config[next++];
    dut.cfg_saturation_min = config[next++];
    dut.cfg_clip_min = config[next++];
    dut.cfg_clipped_weight = config[next++];
    dut.cfg_centre_x = config[next++];
    dut.cfg_centre_y = config[next++];
    dut.cfg_mirror_radius = config[next++];
    dut.cfg_inner_radius = config[next++];
    dut.cfg_cluster_gap = config[next++];
    dut.cfg_min_pixels = config[next++];
    dut.cfg_clockwise = config[next++];
    dut.cfg_lasers = config[next++];
    dut.cfg_first_edge = config[next++];
    dut.cfg_sector_half_width = config[next++];
    dut.cfg_noise_floor = config[next++];
    dut.cfg_noise = config[next++];
    dut.s_axis_tvalid = 0;
    dut.m_axis_tready = 0;
    dut.cfg_azimuth_write = 0;
    dut.clk = 0;
    dut.rst = 1;
    dut.eval();
    for (int i = 0; i < 4; i++) tick();
    dut.rst = 0;
    dut.cfg_azimuth_write = 1;
    for (uint32_t laser = 0; laser < dut.cfg_lasers; laser++) {
        uint32_t azimuth;
        if (fread(&azimuth, sizeof azimuth, 1, stdin) != 1) {
            fprintf(stderr, "an azimuth is missing\n");
            return 1;
        }
        dut.cfg_azimuth_laser = laser;
        dut.cfg_azimuth = azimuth;
        tick();
    }
    dut.cfg_azimuth_write = 0;

    Beat beat;
    bool pending = fread(&beat, sizeof beat, 1, stdin) == 1;
    bool offered = false;
    unsigned blanking = 0, quiet = 0;
    uint64_t clock_of_last_beat = 0, short_rows = 0, long_rows = 0, truncated = 0, stray_rows = 0;
    Record record = {};
    while (pending || quiet < (frames_left > 0 ? clocks_to_drain : clocks_behind)) {
        if (blanking > 0) {
            blanking--;
        } else {
            // What is offered stays until it is taken
            offered = pending && (offered || !stalls(input_stalls));
        }
        dut.s_axis_tvalid = offered;
        if (offered) {
            memcpy(&dut.s_axis_tdata, beat.data, sizeof beat.data);
            dut.s_axis_tuser = beat.flags & 1;
            dut.s_axis_tlast = beat.flags >> 1;
        }
        dut.m_axis_tready = !stalls(output_stalls);
        dut.eval();
        const bool take = dut.s_axis_tvalid && dut.s_axis_tready;
        quiet++;
        if (dut.m_axis_tvalid && dut.m_axis_tready) {
            quiet = 0;
            memcpy(record.data, &dut.m_axis_tdata, sizeof record.data);
            record.last = dut.m_axis_tlast;
            if (dut.m_axis_tlast && frames_left > 0) frames_left--;
            record.clock = clocks;
            record.clock_of_last_beat = clock_of_last_beat;
            fwrite(&record, sizeof record, 1, stdout);
        }
        if (dut.early_valid) {
            quiet = 0;
            memcpy(record.data, &dut.early_data, sizeof record.data);
            record.last = EARLY + dut.early_slot;
            record.clock = clocks;
            record.clock_of_last_beat = clock_of_last_beat;
            fwrite(&record, sizeof record, 1, stdout);
        }
        if (dut.mask_valid) {
            quiet = 0;
            const uint64_t mask[4] = {dut.mask_laser, dut.mask_slots, dut.mask_last, 0};
            memcpy(record.data, mask, sizeof record.data);
            record.last = MASK;
            record.clock = clocks;
            record.clock_of_last_beat = clock_of_last_beat;
            fwrite(&record, sizeof record, 1, stdout);
        }
        short_rows += dut.event_short_row;
        long_rows += dut.event_long_row;
        truncated += dut.event_truncated;
        stray_rows += dut.event_stray_row;
        if (take) {
            quiet = 0;
            clock_of_last_beat = clocks;
            offered = false;
            if ((beat.flags & 2) && most_blanking > 0) blanking = static_cast<unsigned>(random_bits() % most_blanking);
            pending = fread(&beat, sizeof beat, 1, stdin) == 1;
        }
        tick();
    }
    const uint64_t counts[4] = {short_rows, long_rows, truncated, stray_rows};
    memcpy(record.data, counts, sizeof record.data);
    record.last = COUNTS;
    fwrite(&record, sizeof record, 1, stdout);
    return 0;
}
