#!/usr/bin/perl
# A board of the worst case in Perl, without the library: a check of docs/firmware-port.md, and an example for other languages.
# It takes permissions and releases, and surfaces, charges and sinks; it refuses nothing and debounces by one time alone.
use strict;
use warnings;

my $HZ = 32768;
my ($HELLO, $RESET, $RUN, $PIN, $UART_RX) = (1 .. 5);
my ($HELLO_FROM, $SLEEP, $PIN_FROM, $STATE) = (65, 66, 67, 70);
my ($CHARGER, $SURFACE, $BOTTOM, $BATTERY_EMPTY) = (0 .. 3);
my ($CHARGE, $MOTOR_UP, $MOTOR_DOWN, $WATCH_BATTERY) = (0 .. 3);
my ($BOOTING, $ACTIVE, $SURFACING, $FLOATING, $CHARGING, $RELEASED, $SINKING, $EMPTY) = (1 .. 8);

open(my $port, '+<&=', $ENV{MUSSELBED_PORT} // die "no MUSSELBED_PORT: start this by `musselbed mu run`\n") or die $!;
binmode $port;
my ($received, $sent, $now, $stream, $out) = (0, 0, 0, '', '');
my ($levels, %config, $state, $clear_to_sink, $pin_high, $settles_at, $ends_at, $ends_by) = (0);

sub crc {
    my $crc = 0xFFFF;
    for my $byte (unpack 'C*', shift) {
        $crc ^= $byte << 8;
        $crc = ($crc << 1 ^ ($crc & 0x8000 ? 0x1021 : 0)) & 0xFFFF for 1 .. 8;
    }
    return $crc;
}

sub stuffed {    # COBS
    return join '', map {
        my ($block, $text) = ($_, '');
        $text .= "\xFF" . substr($block, 0, 254, '') while length $block >= 254;
        $text . chr(1 + length $block) . $block;
    } split /\0/, shift, -1;
}

sub unstuffed {
    my ($in, $body) = (shift, '');
    while (length $in) {
        my $code = ord substr $in, 0, 1, '';
        $body .= substr $in, 0, $code - 1, '';
        $body .= "\0" if $code < 255 and length $in;
    }
    return $body;
}

sub frame {
    my ($type, $line, $payload) = @_;
    my $body = pack('CCvVV', $type, $line, length $payload, $now, $sent++) . $payload;
    $out .= stuffed($body . pack 'v', crc($body)) . "\0";
}

sub next_frame {
    while (1) {
        if ($stream =~ s/^([^\0]*)\0//) {
            my $body = unstuffed($1);
            my ($type, $line, $size, $counter, $sequence) = unpack 'CCvVV', $body;
            die "a damaged frame\n" if $sequence != $received++ or crc(substr $body, 0, -2) != unpack 'v', substr $body, -2;
            $now = $counter;
            return ($type, $line, substr $body, 12, $size);
        }
        sysread($port, $stream, 4096, length $stream) or exit 0;
    }
}

sub reached { return defined $_[0] && ($now - $_[0] & 0xFFFFFFFF) < 0x80000000 }
sub after { return $now + int($_[0] * $HZ / 1000) & 0xFFFFFFFF }
sub ends { ($ends_at, $ends_by) = (after($_[0]), $_[1]) }
sub run_motors { frame($PIN_FROM, $_[0], chr $_) for 1, 0 }

sub enter {
    $state = shift;
    $ends_at = undef;
    frame($STATE, 0, chr $state);
    run_motors($MOTOR_UP) if $state == $SURFACING;
    run_motors($MOTOR_DOWN) if $state == $SINKING;
    frame($PIN_FROM, $CHARGE, chr($state == $CHARGING)) if $state != $BOOTING;
    frame($PIN_FROM, $WATCH_BATTERY, chr($state == $ACTIVE));
    ends($config{boot}, $ACTIVE) if $state == $BOOTING;
    ends($config{surfacing}, $SINKING) if $state == $SURFACING;
    ends($config{float}, $SINKING) if $state == $FLOATING;
    ends($config{release}, $SINKING) if $state == $RELEASED;
}

sub in { my $of = shift; return grep { $state == $_ } @$of }

sub packet {
    my $data = shift;
    return if length $data != 6 or crc(substr $data, 0, -2) != unpack 'v', substr $data, -2;
    my ($version, $kind, $id) = unpack 'CCv', $data;
    return if $id and $id != $config{id};
    enter($SURFACING) if "$version.$kind" eq '1.2' and in([$ACTIVE, $EMPTY, $SINKING]);
    $clear_to_sink = 1 if "$version.$kind" eq '1.3' and $state == $CHARGING;
    enter($SINKING) if "$version.$kind" eq '1.3' and in([$FLOATING, $RELEASED]);
    enter($SINKING) if "$version.$kind" eq '2.6' and in([$SURFACING, $FLOATING, $RELEASED]);
}

sub pin_settled {
    my $high = $levels >> $CHARGER & 1;
    $settles_at = undef;
    return if $high == $pin_high;
    $pin_high = $high;
    return if $state == $BOOTING;
    $clear_to_sink = 0 if $high;
    enter($CHARGING) if $high and $state != $CHARGING;
    return if $high or $state != $CHARGING;
    enter($RELEASED);
    enter($SINKING) if $clear_to_sink;
}

sub interrupted {
    my ($type, $line, $payload) = next_frame();
    if ($type == $RESET) {
        $pin_high = $levels >> $CHARGER & 1;
        enter($BOOTING);
    }
    packet($payload) if $type == $UART_RX;
    return if $type != $PIN;
    $settles_at = after($config{debounce}) if $line == $CHARGER;
    enter($FLOATING) if $line == $SURFACE and in([$ACTIVE, $EMPTY, $SURFACING, $SINKING]);
    enter($ACTIVE) if $line == $BOTTOM and in([$RELEASED, $SINKING]);
    enter($EMPTY) if $line == $BATTERY_EMPTY and $state == $ACTIVE;
}

while (my ($type, $line, $payload) = next_frame()) {
    if ($type == $HELLO) {
        @config{qw(version id seed debounce boot surfacing float release)} = unpack 'vvV6', $payload;
        frame($HELLO_FROM, 0, pack('v', 1) . 'perl');
    }
    next if $type != $RUN;
    ($levels, my $interrupts) = unpack 'CC', $payload;
    interrupted() for 1 .. $interrupts;
    pin_settled() if reached($settles_at);
    if (reached($ends_at)) {
        my $next = $state != $BOOTING ? $ends_by : $pin_high ? $CHARGING : $levels >> $SURFACE & 1 ? $FLOATING : $ACTIVE;
        enter($next);
    }
    my ($alarm) = sort { ($a - $now & 0xFFFFFFFF) <=> ($b - $now & 0xFFFFFFFF) } grep { defined } $settles_at, $ends_at;
    frame($SLEEP, defined $alarm ? 1 : 0, defined $alarm ? pack 'V', $alarm : '');
    syswrite $port, $out;
    $out = '';
}
