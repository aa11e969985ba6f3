#!/bin/sh
# SPDX-License-Identifier: MIT OR Apache-2.0
#
# ml605.edf to a timing report and a bitstream with ISE 14.7 (settings64.sh sourced). Not run here: nobody has tried it.
set -e
PART=xc6vlx240tff1156-1
ngdbuild -p $PART -uc ml605.ucf ml605.edf ml605.ngd
map -p $PART -w -timing -ol high -o mapped.ncd ml605.ngd ml605.pcf
par -w -ol high mapped.ncd ml605.ncd ml605.pcf
trce -v 10 -o ml605.twr ml605.ncd ml605.pcf
bitgen -w ml605.ncd ml605.bit ml605.pcf
