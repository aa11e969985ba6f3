-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- The frames of one camera that are in its detector, two at most.
--
-- Purpose     what comes out of the detector is of the frame that went in first: tells of which bank that frame is, and
--             whether it is one of a pair
-- Rules       The masks of a frame come after its end, and so do its records
-- Latency     1
-- Throughput  a frame per clock
-- Resources   about 10 LUT and 14 FF
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

entity frame_tags is
  port (
    clk           : in  std_ulogic;  -- rising edge
    rst           : in  std_ulogic;  -- synchronous, high: no frames
    start         : in  std_ulogic;  -- a frame goes in; only with room
    start_bank    : in  std_ulogic;  -- its bank
    finish        : in  std_ulogic;  -- the one that went in last has ended; before the start of the same clock
    finish_paired : in  std_ulogic;  -- it is one of a pair
    masked        : in  std_ulogic;  -- the last mask of a frame has come out
    recorded      : in  std_ulogic;  -- the last record of a frame has come out
    room          : out std_ulogic;  -- another frame may go in
    empty         : out std_ulogic;  -- there is no frame
    mask_bank     : out std_ulogic;  -- of the frame that spots and masks come of
    mask_paired   : out std_ulogic;  -- it is one of a pair, known from its end on
    record_bank   : out std_ulogic;  -- of the frame that records come of
    record_paired : out std_ulogic   -- it is one of a pair, known from its end on
  );
end entity;

architecture rtl of frame_tags is

  signal banks   : std_ulogic_vector(0 to 1);
  signal paired  : std_ulogic_vector(0 to 1);
  signal newest  : unsigned(0 downto 0);  -- place of the frame that went in last
  signal masks   : unsigned(0 downto 0);  -- of the frame that masks come of
  signal records : unsigned(0 downto 0);

  -- Frames whose masks, whose records have not come
  signal unmasked   : unsigned(1 downto 0);
  signal unrecorded : unsigned(1 downto 0);

begin

  room          <= not unmasked(1) and not unrecorded(1);
  empty         <= '1' when unmasked = 0 and unrecorded = 0 else '0';
  mask_bank     <= banks(to_integer(masks));
  mask_paired   <= paired(to_integer(masks));
  record_bank   <= banks(to_integer(records));
  record_paired <= paired(to_integer(records));

  tags_p : process (clk)
    function count(frames : unsigned; more, less : std_ulogic) return unsigned is
    begin
      if more = '1' and less = '0' then
        return frames + 1;
      elsif more = '0' and less = '1' then
        return frames - 1;
      end if;
      return frames;
    end function;
  begin
    if rising_edge(clk) then
      if finish = '1' then
        paired(to_integer(newest)) <= finish_paired;
      end if;
      if start = '1' then
        newest                        <= newest + 1;
        banks(to_integer(newest + 1)) <= start_bank;
      end if;
      if masked = '1' then
        masks <= masks + 1;
      end if;
      if recorded = '1' then
        records <= records + 1;
      end if;
      unmasked   <= count(unmasked, start, masked);
      unrecorded <= count(unrecorded, start, recorded);
      if rst = '1' then
        newest     <= "1";
        masks      <= "0";
        records    <= "0";
        unmasked   <= (others => '0');
        unrecorded <= (others => '0');
      end if;
    end if;
  end process;

end architecture;
