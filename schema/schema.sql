PRAGMA application_id = 1413563208;  -- "TACH"
PRAGMA user_version = 1;

-- the head of a closed part as one row; no row while the part is written
CREATE TABLE summary (
  id INTEGER PRIMARY KEY,                  -- 1
  data BLOB NOT NULL                       -- part, robot, session, stream, coverage, unknown_key and sums of gap again; see summary.cpp
) STRICT;

-- this file: one row
CREATE TABLE part (
  log TEXT NOT NULL,                       -- identity of the log, the same in all its parts
  number INTEGER NOT NULL,                 -- number of this part, from 1; order of parts
  software TEXT NOT NULL,                  -- what created the part
  closed INTEGER NOT NULL,                 -- 1: complete and checkpointed
  counted_to INTEGER NOT NULL,             -- place of the newest answer that the coverage rows count; all of every block
  ended_us INTEGER                         -- when it was closed by a clock known to be right, UTC microseconds; NULL: not known
) STRICT;

-- robots, as configured and as they say they are
CREATE TABLE robot (
  id INTEGER PRIMARY KEY,                  -- the same in all parts
  name TEXT NOT NULL UNIQUE,               -- the user's name for it
  address TEXT NOT NULL,                   -- where it was found: host:status_port:modbus_port
  vehicle_id TEXT NOT NULL,                -- as the robot says; empty until known
  mac TEXT NOT NULL,                       -- as the robot says; empty until known
  model_md5 TEXT NOT NULL,                 -- as the robot says; empty until known
  firmware TEXT NOT NULL                   -- input registers 37-40; empty until known
) STRICT;

-- starts of the recorder that wrote into this part
CREATE TABLE session (
  id INTEGER PRIMARY KEY,                  -- number of the recorder start, the same in all parts
  t_start_us INTEGER NOT NULL,             -- UTC microseconds
  t_end_us INTEGER,                        -- UTC microseconds; NULL while running
  clean INTEGER NOT NULL,                  -- 1: ended as asked, 0: running or killed
  software TEXT NOT NULL,                  -- name and version of the recorder
  config TEXT NOT NULL,                    -- configuration text, verbatim
  host TEXT NOT NULL                       -- host name and zone offset
) STRICT;

-- one source of one robot in one session
CREATE TABLE stream (
  session INTEGER NOT NULL,                -- session.id
  robot INTEGER NOT NULL,                  -- robot.id
  source TEXT NOT NULL,                    -- code list source
  period_us INTEGER NOT NULL,              -- planned period
  word_order TEXT NOT NULL,                -- order of 16-bit words and bytes in 32-bit registers
  request TEXT NOT NULL,                   -- request body, or register ranges
  seq_from INTEGER NOT NULL,               -- first poll number that belongs to this part
  planned INTEGER,                         -- polls the schedule asked for since the session began; NULL until it ended
  PRIMARY KEY (session, robot, source)
) STRICT, WITHOUT ROWID;

-- every field the decoder knows; names are the identity of a column
CREATE TABLE field (
  id INTEGER PRIMARY KEY,                  -- row of the field table; bit in coverage.seen and coverage.valued
  name TEXT NOT NULL,                      -- canonical name
  kind TEXT NOT NULL,                      -- code list kind
  unit TEXT NOT NULL,                      -- SI unit
  json_key TEXT NOT NULL,                  -- key in the 11100 or 11013 answer; empty: not in JSON
  json_scale REAL NOT NULL,                -- JSON number times this = SI value
  former_key TEXT NOT NULL,                -- spelling of older firmware
  register INTEGER NOT NULL,               -- documented address; 0: in no register
  register_type TEXT NOT NULL,             -- code list register_type
  register_scale REAL NOT NULL,            -- register value times this = SI value
  discrete INTEGER NOT NULL,               -- 1: discrete input [1x], 0: input register [3x]
  condition TEXT NOT NULL,                 -- name of a flag; while it is false the field means nothing
  code_list TEXT NOT NULL,                 -- code.list
  sentinel TEXT NOT NULL,                  -- code list sentinel: the value that means not supplied
  retired INTEGER NOT NULL,                -- 1: struck out in the vendor's document
  meaning TEXT NOT NULL                    -- one clause
) STRICT;

-- numbers and their names: code lists of fields, and the lists of this schema
CREATE TABLE code (
  list TEXT NOT NULL,                      -- name of the list
  value INTEGER NOT NULL,                  -- the number
  name TEXT NOT NULL,                      -- its name
  meaning TEXT NOT NULL,                   -- one clause
  PRIMARY KEY (list, value)
) STRICT, WITHOUT ROWID;

-- what this part holds of each stream, counted up to part.counted_to
CREATE TABLE coverage (
  session INTEGER NOT NULL,                -- session.id
  robot INTEGER NOT NULL,                  -- robot.id
  source TEXT NOT NULL,                    -- code list source
  stored INTEGER NOT NULL,                 -- answers in this part; 0: only last_us means something
  bytes INTEGER NOT NULL,                  -- sum of their lengths as received
  undecodable INTEGER NOT NULL,            -- answers that are stored but could not be decoded
  first_us INTEGER NOT NULL,               -- smallest send time, UTC microseconds
  last_us INTEGER NOT NULL,                -- largest send time, also of earlier parts when stored is 0
  next_seq INTEGER NOT NULL,               -- number after the last stored poll; 0: none stored
  seen BLOB NOT NULL,                      -- bit field.id (lowest first): the field was ever not absent
  valued BLOB NOT NULL,                    -- bit field.id (lowest first): the field ever had a value (state present)
  PRIMARY KEY (session, robot, source)
) STRICT, WITHOUT ROWID;

-- keys of answers that no field names
CREATE TABLE unknown_key (
  robot INTEGER NOT NULL,                  -- robot.id
  source TEXT NOT NULL,                    -- code list source
  key TEXT NOT NULL,                       -- path of the key
  first_us INTEGER NOT NULL,               -- first answer of this part that had it, UTC microseconds
  PRIMARY KEY (robot, source, key)
) STRICT, WITHOUT ROWID;

-- what the small tables have; of a closed part also how many other rows
CREATE TABLE seal (
  name TEXT PRIMARY KEY,                   -- of the table; 'field names', 'code names': of the columns that opening a log needs
  rows INTEGER NOT NULL,                   -- how many it has
  crc INTEGER                              -- CRC-32C of all their columns; NULL: each row has its own
) STRICT, WITHOUT ROWID;

-- stored answers in order of arrival: those of one stream between two commits
CREATE TABLE hot (
  id INTEGER PRIMARY KEY,                  -- place of the first answer in the order of arrival of all answers of this part
  robot INTEGER NOT NULL,                  -- robot.id
  source INTEGER NOT NULL,                 -- code list source
  session INTEGER NOT NULL,                -- session.id
  seq INTEGER NOT NULL,                    -- number of the first planned poll in its stream, from 0
  t_send_us INTEGER NOT NULL,              -- its request handed to the kernel, UTC microseconds
  base INTEGER,                            -- hot.id of the row whose last body these are compressed against; NULL: a keyframe
  rows INTEGER NOT NULL,                   -- answers
  crc INTEGER NOT NULL,                    -- CRC-32C of the other columns
  data BLOB NOT NULL                       -- their places, polls, times, lengths and bodies, see schema/store/block/FORMAT.md
) STRICT;

-- stored answers of one stream that were moved out of hot
CREATE TABLE block (
  id INTEGER PRIMARY KEY,                  -- order of moving
  robot INTEGER NOT NULL,                  -- robot.id
  source INTEGER NOT NULL,                 -- code list source
  session INTEGER NOT NULL,                -- session.id
  seq_from INTEGER NOT NULL,               -- first poll; polls in between may be missing
  seq_to INTEGER NOT NULL,                 -- last poll
  row_from INTEGER NOT NULL,               -- place of the first answer in the order of arrival; each answer keeps its own
  row_to INTEGER NOT NULL,                 -- place of the last answer
  t_from_us INTEGER NOT NULL,              -- smallest send time, UTC microseconds
  t_to_us INTEGER NOT NULL,                -- largest send time, UTC microseconds
  rows INTEGER NOT NULL,                   -- answers
  crc INTEGER NOT NULL,                    -- CRC-32C of the other columns but id and data, which has its own
  data BLOB NOT NULL                       -- see schema/store/block/FORMAT.md
) STRICT;

-- planned polls without an answer
CREATE TABLE gap (
  id INTEGER PRIMARY KEY,                  -- order of arrival
  robot INTEGER NOT NULL,                  -- robot.id
  source TEXT NOT NULL,                    -- code list source
  session INTEGER NOT NULL,                -- session.id
  seq_from INTEGER NOT NULL,               -- first poll concerned
  seq_count INTEGER NOT NULL,              -- polls concerned
  t_from_us INTEGER NOT NULL,              -- UTC microseconds
  t_to_us INTEGER NOT NULL,                -- UTC microseconds
  cause TEXT NOT NULL,                     -- code list cause
  partial INTEGER NOT NULL,                -- 1: the polls are stored, but some register ranges are not
  detail TEXT NOT NULL,                    -- words of the system or the robot
  crc INTEGER NOT NULL                     -- CRC-32C of the other columns but id
) STRICT;

-- what happened, seen while recording
CREATE TABLE event (
  id INTEGER PRIMARY KEY,                  -- order of arrival
  robot INTEGER NOT NULL,                  -- robot.id
  source TEXT NOT NULL,                    -- code list source
  session INTEGER NOT NULL,                -- session.id
  kind TEXT NOT NULL,                      -- code list event
  seq INTEGER NOT NULL,                    -- poll it was seen in
  t_from_us INTEGER NOT NULL,              -- it happened after this, UTC microseconds
  t_us INTEGER NOT NULL,                   -- and not later than this
  subject TEXT NOT NULL,                   -- what it is about
  old_value TEXT NOT NULL,                 -- before; empty when unknown
  new_value TEXT NOT NULL,                 -- after
  detail TEXT NOT NULL,                    -- the robot's own words
  crc INTEGER NOT NULL                     -- CRC-32C of the other columns but id
) STRICT;

-- what fields did per minute, of answers that are in blocks
CREATE TABLE rollup (
  robot INTEGER NOT NULL,                  -- robot.id
  source INTEGER NOT NULL,                 -- code list source
  minute INTEGER NOT NULL,                 -- UTC minutes since 1970, of the middle of the answer; datetime(minute * 60, 'unixepoch')
  field INTEGER NOT NULL,                  -- field.id
  rows INTEGER NOT NULL,                   -- answers that had a value; absent, not meaningful and not supplied are none
  min REAL NOT NULL,                       -- in the unit of the field; flags are 0 and 1, alarm lists their length
  max REAL NOT NULL,                       -- likewise
  sum REAL NOT NULL,                       -- over rows: the mean
  last REAL NOT NULL,                      -- in order of arrival
  crc INTEGER NOT NULL,                    -- CRC-32C of the other columns
  PRIMARY KEY (robot, source, minute, field)
) STRICT, WITHOUT ROWID;

-- how many answers there are per hour, and a sum over them, of answers that are in blocks
CREATE TABLE manifest (
  robot INTEGER NOT NULL,                  -- robot.id
  source INTEGER NOT NULL,                 -- code list source
  hour_us INTEGER NOT NULL,                -- start of the UTC hour of the send time, UTC microseconds
  rows INTEGER NOT NULL,                   -- answers
  hash INTEGER NOT NULL,                   -- sum of their hashes modulo 2^64, see schema/store/block/FORMAT.md
  crc INTEGER NOT NULL,                    -- CRC-32C of the other columns
  PRIMARY KEY (robot, source, hour_us)
) STRICT, WITHOUT ROWID;

-- host wall clock, host monotonic clock and robot clock at one instant
CREATE TABLE clock (
  id INTEGER PRIMARY KEY,                  -- order of arrival
  robot INTEGER NOT NULL,                  -- robot.id; 0: host clocks only
  session INTEGER NOT NULL,                -- session.id
  wall_us INTEGER NOT NULL,                -- host wall clock, UTC microseconds
  mono_us INTEGER NOT NULL,                -- host monotonic clock, microseconds
  robot_us INTEGER,                        -- robot clock, UTC microseconds
  crc INTEGER NOT NULL                     -- CRC-32C of the other columns but id
) STRICT;
