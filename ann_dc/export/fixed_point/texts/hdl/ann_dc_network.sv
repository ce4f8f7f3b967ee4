// @title@: a network in integers of @bits@ bits.
// Written by ann_dc; wiring @wiring@, content @content@.
// Word ranges were chosen for @covers@.
//
// A machine with one multiplier of @bits@+1 by @wide@+1 bits: it takes the operations of a step one
// after the other from a program memory, and of a sum one edge a clock. Memories are read through
// registers.

/* verilator lint_off WIDTH */
/* verilator lint_off UNUSEDSIGNAL */
module ann_dc_network (
    input  logic                      clock,
    input  logic                      reset,
    input  logic                      restart,        // to the start, with the inputs of the export
    input  logic                      run,            // take steps ...
    input  logic [31:0]               limit,          // ... so many at most, LIMIT if it is 0 ...
    input  logic                      until_settled,  // ... or until the network is settled
    output logic                      busy,
    output logic                      settled,
    output logic                      saturated,      // a number was cut off since the restart
    output logic [1:0]                status,         // RUNNING, SETTLED, SATURATED or LIMITED
    output logic [31:0]               steps,          // since the last restart
    input  logic                      load,           // while not busy: data into an input, RUNNING
    input  logic [@word_at@-1:0]      address,
    input  logic signed [@bits@-1:0]  data,
    output logic signed [@bits@-1:0]  word,           // what is there, a clock after its address
    output logic signed [@wide@-1:0]  fine            // the same with its guard bits
);
    localparam int BITS = @bits@, WORD = @wide@, WIDE = @accumulator@, PERIOD = @period@, LIMIT = @limit@;
    localparam int WORDS = @words@, NEURONS = @neurons@, OPERATIONS = @operations@;
    localparam int EDGES = @edges@, TABLES = @tables@, ENTRIES = @entries@;
    localparam int WORD_AT = @word_at@, NEURON_AT = @neuron_at@, ANY_AT = @any_at@;
    localparam int OPERATION_AT = @operation_at@, EDGE_AT = @edge_at@, ENTRY_AT = @entry_at@;
    localparam int TABLE_AT = @table_at@;
    localparam logic signed [6:0] GUARD = @guard@;

    localparam logic [2:0] SUM = 0, PRODUCT = 1, FUNCTION = 2, RECTIFY = 3, DRIVE = 4, UPDATE = 5;
    localparam logic [4:0] IDLE = 0, COPY = 1, STORE = 2, FETCH = 3, DECODE = 4, ADD = 5, READ = 6,
        AGAIN = 7, PLACE = 8, LEFT = 9, RIGHT = 10, SLOPE = 11, MULTIPLY = 12, ROUND = 13,
        WRITE = 14, COUNT = 15, LOOK = 16, MARK = 17, STILL = 18, SMALL = 19, DONE = 20;
    localparam logic [1:0] RUNNING = 0, SETTLED = 1, SATURATED = 2, LIMITED = 3;
    localparam logic signed [WIDE-1:0] ONE = 1;
    localparam logic signed [WIDE-1:0] TOP = (ONE <<< (WORD - 1)) - ONE;
    localparam logic signed [WIDE-1:0] NARROW_TOP = (ONE <<< (BITS - 1)) - ONE;

    // ---- memories --------------------------------------------------------------------

    logic [10+NEURON_AT+3*ANY_AT-1:0] program_memory [0:OPERATIONS-1];
    logic [BITS+6+WORD_AT-1:0]        edge_memory    [0:EDGES-1];
    logic [2*BITS+5+ENTRY_AT-1:0]     table_memory   [0:TABLES-1];
    logic [WORD-1:0]                  entry_memory   [0:ENTRIES-1];
    logic [WORD-1:0]                  start_memory   [0:WORDS-1];
    logic [2*WORD_AT+5*WORD-1:0]      neuron_memory  [0:NEURONS-1];
    logic [WORD-1:0]                  words          [0:WORDS-1];
    logic [WORD-1:0]                  marks          [0:NEURONS-1];

    initial begin
        $readmemh("operations.hex", program_memory);
        $readmemh("edges.hex", edge_memory);
        $readmemh("tables.hex", table_memory);
        $readmemh("entries.hex", entry_memory);
        $readmemh("start.hex", start_memory);
        $readmemh("neurons.hex", neuron_memory);
    end

    // What they gave at the last clock.
    logic [10+NEURON_AT+3*ANY_AT-1:0] operation;
    logic [BITS+6+WORD_AT-1:0]        edge_read;
    logic [2*BITS+5+ENTRY_AT-1:0]     table_read;
    logic [2*WORD_AT+5*WORD-1:0]      neuron_read;
    logic signed [WORD-1:0]           entry_read, start_read, word_read, mark_read;

    logic [2:0]              kind;
    logic signed [6:0]       shift;
    logic [NEURON_AT-1:0]    owner;
    logic [ANY_AT-1:0]       target, first, last;
    assign {kind, shift, owner, target, first, last} = operation;

    logic signed [BITS-1:0]  coefficient;
    logic [5:0]              exponent;
    logic [WORD_AT-1:0]      source;
    assign {coefficient, exponent, source} = edge_read;

    logic signed [BITS-1:0]  lowest, highest;
    logic [4:0]              spacing;
    logic [ENTRY_AT-1:0]     entry_first;
    assign {lowest, highest, spacing, entry_first} = table_read;

    logic [WORD_AT-1:0]      own_word, driven;
    logic signed [WORD-1:0]  at_start, low, high;
    logic [WORD-1:0]         still_most, small_most;
    assign {own_word, at_start, low, high, still_most, driven, small_most} = neuron_read;

    // ---- registers --------------------------------------------------------------------------

    logic [4:0]              phase;
    logic [OPERATION_AT-1:0] counter;                 // of operations
    logic [WORD_AT-1:0]      place;                   // of words copied, of neurons marked
    logic [EDGE_AT-1:0]      edge_at;
    logic                    edge_there, word_there;  // in the stages of a sum
    logic                    still, stop, limited;
    logic [5:0]              lift;                    // exponent of the coefficient on the left
    logic [31:0]             taken, most, since_mark;
    logic signed [BITS:0]    left;                    // of the multiplier
    logic signed [WORD:0]    right;
    logic signed [WORD-1:0]  base;                    // table entry to the left
    logic [ENTRY_AT-1:0]     entry_at;
    logic signed [WIDE-1:0]  total, value;

    assign fine = word_read;
    assign word = clipped(narrow, -NARROW_TOP - ONE, NARROW_TOP);
    assign busy = phase != IDLE;
    assign status = saturated ? SATURATED : settled ? SETTLED : limited ? LIMITED : RUNNING;

    logic [WORD_AT-1:0]   word_at;
    logic [NEURON_AT-1:0] neuron_at;

    always_comb begin
        case (phase)
            ADD:         word_at = source;
            READ:        word_at = kind == PRODUCT ? first : last;
            AGAIN:       word_at = last;
            ROUND, MARK: word_at = own_word;
            STILL:       word_at = driven;
            default:     word_at = address;
        endcase
        case (phase)
            COPY, LOOK, MARK, STILL: neuron_at = place;
            default:     neuron_at = owner;
        endcase
    end

    always_ff @(posedge clock) begin
        operation <= program_memory[counter];
        edge_read <= edge_memory[edge_at];
        table_read <= table_memory[first[TABLE_AT-1:0]];
        entry_read <= entry_memory[entry_at];
        start_read <= start_memory[place];
        neuron_read <= neuron_memory[neuron_at];
        word_read <= words[word_at];
        mark_read <= marks[neuron_at];
    end

    // ---- arithmetic -------------------------------------------------------------------------

    function automatic logic signed [WIDE-1:0] clipped(
        input logic signed [WIDE-1:0] a,
        input logic signed [WIDE-1:0] least,
        input logic signed [WIDE-1:0] largest
    );
        clipped = a < least ? least : (a > largest ? largest : a);
    endfunction

    // a / 2^by to the nearest integer, halves upward.
    function automatic logic signed [WIDE-1:0] rounded(
        input logic signed [WIDE-1:0] a,
        input logic signed [6:0] by
    );
        logic [6:0] less, back;
        less = by - 1;
        back = -by;
        if (by > 0) rounded = (a + (ONE <<< less)) >>> by;
        else rounded = a <<< back;
    endfunction

    logic signed [6:0]       spaced;
    logic signed [WORD:0]    factor;
    logic signed [BITS:0]    argument, share;
    logic signed [WIDE-1:0]  narrow, product, whole, kept, result;
    logic signed [WORD+1:0]  distance, allowed;
    logic                    outward, beyond, far;

    always_comb begin
        spaced = {2'b00, spacing};
        narrow = rounded(word_read, GUARD);
        factor = kind == FUNCTION ? right : (kind == PRODUCT ? narrow : word_read);
        product = left * factor;
        argument = clipped(narrow, lowest, highest) - lowest;
        beyond = narrow < lowest || narrow > highest;
        share = argument - ((argument >> spacing) << spacing);
        whole = kind == UPDATE ? word_read + value : value;
        kept = kind == UPDATE ? clipped(whole, low, high) : clipped(whole, -TOP - ONE, TOP);
        outward = (word_read <= low && kept < 0) || (word_read >= high && kept > 0);
        result = kind == DRIVE && outward ? 0 : kept;
        distance = phase == STILL ? word_read - mark_read : word_read;
        allowed = {2'b00, phase == STILL ? still_most : small_most};
        far = distance > allowed || -distance > allowed;
    end

    // ---- writes ----------------------------------------------------------------------

    always_ff @(posedge clock) begin
        case (phase)
            IDLE: if (load) words[address] <= {data, {@guard@{1'b0}}};
            STORE: words[place] <= start_read;
            WRITE: words[kind == UPDATE ? own_word : target[WORD_AT-1:0]] <= result[WORD-1:0];
            default: ;
        endcase
        if (phase == STORE && place < NEURONS) marks[place[NEURON_AT-1:0]] <= at_start;
        if (phase == STILL) marks[place[NEURON_AT-1:0]] <= word_read;
    end

    // ---- the order of things ----------------------------------------------------------------

    always_ff @(posedge clock) begin
        case (phase)
            IDLE: begin
                counter <= 0;
                edge_at <= 0;
                place <= 0;
                taken <= 0;
                most <= limit == 0 ? LIMIT : limit;
                stop <= until_settled;
                if (restart) begin
                    steps <= 0;
                    since_mark <= 0;
                    settled <= 0;
                    limited <= 0;
                    saturated <= 0;
                    phase <= COPY;
                end else if (run) begin
                    settled <= 0;
                    limited <= 0;
                    phase <= FETCH;
                end else if (load) begin
                    settled <= 0;
                    limited <= 0;
                end
            end
            COPY: phase <= STORE;
            STORE: begin
                place <= place + 1;
                phase <= place == WORDS - 1 ? IDLE : COPY;
            end
            FETCH: phase <= DECODE;
            DECODE: begin
                total <= 0;
                edge_there <= 0;
                word_there <= 0;
                phase <= kind == SUM || kind == DRIVE || kind == UPDATE ? ADD : READ;
            end
            ADD: begin
                edge_there <= edge_at != last[EDGE_AT-1:0];
                word_there <= edge_there;
                left <= coefficient;
                lift <= exponent;
                if (edge_at != last[EDGE_AT-1:0]) edge_at <= edge_at + 1;
                else if (!edge_there && !word_there) phase <= ROUND;
                if (word_there) total <= total + (product <<< lift);
            end
            READ: phase <= kind == PRODUCT ? AGAIN : (kind == FUNCTION ? PLACE : MULTIPLY);
            AGAIN: begin
                left <= narrow;
                phase <= MULTIPLY;
            end
            PLACE: begin
                entry_at <= entry_first + (argument >> spacing);
                left <= share;
                if (beyond) saturated <= 1;
                phase <= LEFT;
            end
            LEFT: begin
                entry_at <= entry_at + 1;
                phase <= RIGHT;
            end
            RIGHT: begin
                base <= entry_read;
                phase <= SLOPE;
            end
            SLOPE: begin
                right <= entry_read - base;
                phase <= MULTIPLY;
            end
            MULTIPLY: begin
                total <= product;
                if (kind == RECTIFY) total <= word_read < 0 ? 0 : word_read;
                phase <= ROUND;
            end
            ROUND: begin
                value <= kind == FUNCTION ? base + rounded(total, spaced) : rounded(total, shift);
                phase <= WRITE;
            end
            WRITE: begin
                if (kept != whole && (result == TOP || result == -TOP - ONE)) saturated <= 1;
                counter <= counter + 1;
                phase <= counter == OPERATIONS - 1 ? COUNT : FETCH;
            end
            COUNT: begin
                counter <= 0;
                edge_at <= 0;
                place <= 0;
                still <= 1;
                steps <= steps + 1;
                taken <= taken + 1;
                since_mark <= since_mark == PERIOD - 1 ? 0 : since_mark + 1;
                if (since_mark == PERIOD - 1) phase <= LOOK;
                else begin
                    settled <= 0;
                    phase <= taken + 1 == most ? IDLE : FETCH;
                    limited <= stop && taken + 1 == most;
                end
            end
            LOOK: phase <= MARK;
            MARK: phase <= STILL;
            STILL: begin
                if (far) still <= 0;
                phase <= SMALL;
            end
            SMALL: begin
                if (far) still <= 0;
                place <= place + 1;
                phase <= place == NEURONS - 1 ? DONE : LOOK;
            end
            DONE: begin
                settled <= still && !saturated;
                limited <= stop && !(still && !saturated) && taken == most;
                phase <= (still && !saturated && stop) || taken == most ? IDLE : FETCH;
            end
            default: phase <= IDLE;
        endcase
        if (reset) phase <= IDLE;
    end
endmodule

