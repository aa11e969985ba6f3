// SPDX-License-Identifier: MIT OR Apache-2.0
//
// A part of the simulated SoC that is a model of its own and rests while nothing in it would change.
//
// What a synchronous part is after a clock follows from what it was and from its inputs. So once a clock has changed nothing,
// the next one changes nothing either, as long as the inputs stay: until then the stand-in within the SoC, which
// crates/xtask/src/hw/parts.rs writes, passes the part over.

#include <cstring>
#include <vector>

#include "svdpi.h"

// State is all that the model consists of: without hierarchy
template <class Model, class State> class Part {
  public:
    // A rising edge with these inputs, and the outputs after it. False: it has changed nothing
    bool clock(const svBitVecVal* in, svBitVecVal* out) {
        const bool looks = ++clocks % LOOK_EVERY == 0;
        memcpy(model.in.data(), in, sizeof model.in);
        level(0);
        if (looks) memcpy(before.data(), model.rootp, sizeof(State));
        level(1);
        memcpy(out, model.out.data(), sizeof model.out);
        if (!looks) return true;
        level(0);
        return memcmp(before.data(), model.rootp, sizeof(State)) != 0;
    }

  private:
    // To look takes a copy of the state
    enum { LOOK_EVERY = 32 };

    Model model;
    std::vector<char> before = std::vector<char>(sizeof(State));
    unsigned clocks = 0;

    void level(int clk) {
        model.clk = clk;
        model.eval();
    }
};
