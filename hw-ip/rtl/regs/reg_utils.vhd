-- SPDX-License-Identifier: MIT OR Apache-2.0
--
-- Conversions that the generated register block calls.
--
-- Purpose     the functions of this name that karst_regs.vhd uses; PeakRDL's own package has many more
-- Latency     none: functions
-- Twin        none

library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;

package reg_utils is

  function to_unsigned(vector : std_ulogic_vector) return unsigned;
  function to_std_logic_vector(number : unsigned) return std_ulogic_vector;
  function to_std_logic(condition : boolean) return std_ulogic;

end package;

package body reg_utils is

  function to_unsigned(vector : std_ulogic_vector) return unsigned is
  begin
    return unsigned(vector);
  end function;

  function to_std_logic_vector(number : unsigned) return std_ulogic_vector is
  begin
    return std_ulogic_vector(number);
  end function;

  function to_std_logic(condition : boolean) return std_ulogic is
  begin
    if condition then
      return '1';
    end if;
    return '0';
  end function;

end package body;
