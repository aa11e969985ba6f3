-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Rounding and saturation of signed numbers.
--
-- Purpose     the last steps of every fixed-point product
-- Latency     none: functions
-- Resources   one adder of the result's width; one comparison
-- Twin        karst_math::round_shift, karst_math::saturate_i32

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

package rounding is

  -- value / 2 ** bits, halves up; one bit wider than what is left of the value, so that it cannot overflow
  function round_shift(value : signed; bits : positive) return signed;

  -- The nearest number of `width` bits
  function saturate(value : signed; width : positive) return signed;

  -- The absolute value, one bit wider, so that it cannot overflow. (GHDL 2.0 converts abs to something that is no Verilog)
  function magnitude(value : signed) return unsigned;

end package;

package body rounding is

  function round_shift(value : signed; bits : positive) return signed is
    alias v : signed(value'length - 1 downto 0) is value;
    variable half : signed(1 downto 0);
  begin
    -- The bit below the point is the half
    half := '0' & v(bits - 1);
    return resize(v(v'high downto bits), value'length - bits + 1) + half;
  end function;

  function saturate(value : signed; width : positive) return signed is
    alias v : signed(value'length - 1 downto 0) is value;
    variable nearest : signed(width - 1 downto 0);
  begin
    nearest := v(width - 1 downto 0);
    if v(v'high downto width - 1) /= 0 and v(v'high downto width - 1) /= -1 then
      nearest            := (others => not v(v'high));
      nearest(width - 1) := v(v'high);
    end if;
    return nearest;
  end function;

  function magnitude(value : signed) return unsigned is
    variable wide : signed(value'length downto 0);
  begin
    wide := resize(value, value'length + 1);
    if wide(wide'high) = '1' then
      wide := -wide;
    end if;
    return unsigned(wide);
  end function;

end package body;
