-- The engine: dissects a datagram by the tables above. It checks every length before it reads: a Lua error would hide the
-- rest of the datagram.

local MAX_DATAGRAM, MAX_DATA, HEADER = 548, 528, 16
local IDD_ED3, IDD_ED4 = 30, 32
local EPOCH_UNIX_S = 946684800

local proto = Proto("stanag4586", "STANAG 4586 DLI")

local CHECKSUMS = { [0] = "none", "sum, 2 bytes", "sum, 4 bytes", "CRC-32" }
local CHECKSUM_BYTES = { [0] = 0, 2, 4, 4 }

local MESSAGE_NAMES, MESSAGE_NAMES_25 = {}, {}
for id, message in pairs(MESSAGES) do MESSAGE_NAMES[id] = message.name end
for id, message in pairs(MESSAGES_25) do MESSAGE_NAMES_25[id] = message.name end

local header = {
  reserved = ProtoField.uint16("stanag4586.reserved", "Reserved", base.HEX),
  length = ProtoField.uint16("stanag4586.length", "Message Length", base.DEC),
  source = ProtoField.uint32("stanag4586.source", "Source ID", base.HEX),
  destination = ProtoField.uint32("stanag4586.destination", "Destination ID", base.HEX),
  type = ProtoField.uint16("stanag4586.type", "Message Type", base.DEC, MESSAGE_NAMES),
  properties = ProtoField.uint16("stanag4586.properties", "Message Properties", base.HEX),
  ack = ProtoField.bool("stanag4586.ack", "Acknowledgement required", 16, nil, 0x8000),
  idd = ProtoField.uint16("stanag4586.idd", "IDD version", base.DEC, nil, 0x7F00),
  style = ProtoField.uint16("stanag4586.checksum_style", "Checksum", base.DEC, CHECKSUMS, 0x00C0),
  presence = ProtoField.bytes("stanag4586.presence", "Presence Vector"),
  data = ProtoField.bytes("stanag4586.data", "Message Data"),
  checksum = ProtoField.uint32("stanag4586.checksum", "Checksum", base.HEX),
  trailing = ProtoField.bytes("stanag4586.trailing", "Trailing bytes"),
  -- Edition 2.5
  version = ProtoField.string("stanag4586.version", "IDD Version"),
  instance = ProtoField.uint32("stanag4586.instance", "Message Instance ID", base.DEC),
  type_25 = ProtoField.uint32("stanag4586.ed25.type", "Message Type", base.DEC, MESSAGE_NAMES_25),
  length_25 = ProtoField.uint32("stanag4586.ed25.length", "Message Length", base.DEC),
  stream = ProtoField.uint32("stanag4586.stream", "Stream ID", base.DEC),
  sequence = ProtoField.uint32("stanag4586.sequence", "Packet Sequence Number", base.HEX),
}

local expert = {
  oversized = ProtoExpert.new("stanag4586.oversized", "Datagram longer than 548 bytes",
    expert.group.PROTOCOL, expert.severity.WARN),
  short = ProtoExpert.new("stanag4586.short", "Datagram ends within a message",
    expert.group.PROTOCOL, expert.severity.ERROR),
  length = ProtoExpert.new("stanag4586.bad_length", "Message Length out of range",
    expert.group.PROTOCOL, expert.severity.ERROR),
  idd = ProtoExpert.new("stanag4586.unknown_idd", "IDD version that is not known",
    expert.group.PROTOCOL, expert.severity.ERROR),
  style = ProtoExpert.new("stanag4586.bad_checksum_style", "Checksum style that Edition 3 does not have",
    expert.group.PROTOCOL, expert.severity.ERROR),
  checksum = ProtoExpert.new("stanag4586.bad_checksum", "Wrong checksum",
    expert.group.CHECKSUM, expert.severity.ERROR),
  unknown = ProtoExpert.new("stanag4586.unknown_type", "Message type without a known layout",
    expert.group.UNDECODED, expert.severity.NOTE),
  presence = ProtoExpert.new("stanag4586.bad_presence", "Presence vector missing, or with unknown bits",
    expert.group.PROTOCOL, expert.severity.ERROR),
  field = ProtoExpert.new("stanag4586.short_field", "Message data ends within a field",
    expert.group.PROTOCOL, expert.severity.ERROR),
  unsized = ProtoExpert.new("stanag4586.unknown_length", "Field of unknown length",
    expert.group.UNDECODED, expert.severity.WARN),
  trailing = ProtoExpert.new("stanag4586.trailing_bytes", "Bytes after the last field",
    expert.group.PROTOCOL, expert.severity.ERROR),
  range = ProtoExpert.new("stanag4586.out_of_range", "Value outside its range",
    expert.group.PROTOCOL, expert.severity.WARN),
}

-- type on the wire: bytes, constructor of its ProtoField, whether it is signed
local WIRES = {
  u8 = { 1, ProtoField.uint8 }, u16 = { 2, ProtoField.uint16 }, u24 = { 3, ProtoField.uint24 },
  u32 = { 4, ProtoField.uint32 }, u40 = { 5, ProtoField.uint64 },
  i8 = { 1, ProtoField.int8, true }, i16 = { 2, ProtoField.int16, true },
  i24 = { 3, ProtoField.int24, true }, i32 = { 4, ProtoField.int32, true },
  bam16 = { 2, ProtoField.int16, true }, bam32 = { 4, ProtoField.int32, true },
  f32 = { 4, ProtoField.double }, f64 = { 8, ProtoField.double },
}

-- Registers the ProtoFields of a field: its value; for a scaled one also the value on the wire, for a bitmap also its bits.
local all = {}
local function register(field)
  all[#all + 1] = field
  return field
end

for _, field in pairs(header) do register(field) end

local function register_message(message, prefix, enums)
  for _, field in ipairs(message.fields) do
    local abbreviation = prefix .. message.short .. "." .. field.short
    local wire = WIRES[field.wire]
    local enum = field.enum and enums[field.enum]
    field.values = enum
    if field.chars then
      field.proto = register(ProtoField.string(abbreviation, field.name))
    elseif not wire then
      field.proto = register(ProtoField.bytes(abbreviation, field.name))
    elseif field.id then
      field.proto = register(ProtoField.uint32(abbreviation, field.name, base.HEX))
    elseif field.step then
      field.proto = register(ProtoField.double(abbreviation, field.name))
      field.raw = register(wire[2](abbreviation .. ".raw", field.name .. ", on the wire"))
    elseif field.wire == "f32" or field.wire == "f64" then
      field.proto = register(ProtoField.double(abbreviation, field.name))
    elseif enum and enum.bits then
      field.proto = register(wire[2](abbreviation, field.name, base.HEX))
      field.bits = {}
      for _, bit in ipairs(enum.bits) do
        field.bits[#field.bits + 1] = register(ProtoField.bool(
          abbreviation .. "." .. bit.short, bit.name, 8 * wire[1], nil, bit.mask))
      end
    elseif enum then
      field.proto = register(wire[2](abbreviation, field.name, base.DEC, enum.values))
    else
      field.proto = register(wire[2](abbreviation, field.name))
    end
  end
end

for _, message in pairs(MESSAGES) do register_message(message, "stanag4586.", ENUMS) end
for _, message in pairs(MESSAGES_25) do register_message(message, "stanag4586.ed25.", ENUMS_25) end

proto.fields = all
local experts = {}
for _, entry in pairs(expert) do experts[#experts + 1] = entry end
proto.experts = experts

proto.prefs.ports = Pref.range("UDP ports", "4586,51017",
  "UDP ports that carry DLI messages", 65535)
proto.prefs.heuristics = Pref.bool("Find DLI messages on other ports", true,
  "Take datagrams on other ports if every message in them is valid")

-- Arithmetic only: bit operators and bit libraries differ between the versions of Lua that Wireshark is built with.
local function xor(a, b)
  local result, place = 0, 1
  while a > 0 or b > 0 do
    local x, y = a % 2, b % 2
    if x ~= y then result = result + place end
    a, b, place = (a - x) / 2, (b - y) / 2, place * 2
  end
  return result
end

local crc_table = {}
for byte = 0, 255 do
  local remainder = byte
  for _ = 1, 8 do
    local low = remainder % 2
    remainder = (remainder - low) / 2
    if low == 1 then remainder = xor(remainder, 0xEDB88320) end
  end
  crc_table[byte] = remainder
end

local function crc32(bytes)
  local remainder = 0xFFFFFFFF
  for index = 1, #bytes do
    local low = remainder % 256
    remainder = xor((remainder - low) / 256, crc_table[math.floor(xor(low, bytes:byte(index)))])
  end
  return xor(remainder, 0xFFFFFFFF)
end

local function sum(bytes, modulus)
  local total = 0
  for index = 1, #bytes do total = (total + bytes:byte(index)) % modulus end
  return total
end

local function checksum_of(style, bytes)
  if style == 1 then return sum(bytes, 0x10000) end
  if style == 2 then return sum(bytes, 0x100000000) end
  return crc32(bytes)
end

local function unsigned(bytes)
  local value = 0
  for index = 1, #bytes do value = value * 256 + bytes:byte(index) end
  return value
end

local function signed(bytes)
  local value = unsigned(bytes)
  local whole = 256 ^ #bytes
  if value >= whole / 2 then value = value - whole end
  return math.floor(value)
end

local function id_text(value)
  local bytes = {}
  for _ = 1, 4 do
    local low = value % 256
    table.insert(bytes, 1, string.format("%02x", math.floor(low)))
    value = (value - low) / 256
  end
  return table.concat(bytes, ":")
end

-- Not tostring(): Lua 5.3 and later write 1.0 where 5.2 writes 1.
local function number_text(value)
  return (string.format("%.10g", value))
end

local function utc_text(milliseconds)
  local seconds = math.floor(milliseconds / 1000)
  if seconds < 0 or seconds > 2 ^ 33 then return nil end
  return os.date("!%Y-%m-%d %H:%M:%S", EPOCH_UNIX_S + seconds)
    .. string.format(".%03d UTC", math.floor(milliseconds - seconds * 1000))
end

-- The text of the range of reserved or VSM specific values that contains the value.
local function range_text(enum, value)
  for _, range in ipairs(enum.ranges or {}) do
    if value >= range[1] and value <= range[2] then return range[3] end
  end
end

local function check_range(item, field, value)
  if field.low and (value < field.low or value > field.high) then
    item:add_proto_expert_info(expert.range, string.format("%s, expected %s to %s",
      number_text(value), number_text(field.low), number_text(field.high)))
  end
end

-- Levels of interoperability, as people call them.
local LEVELS = {
  ["LOI 2"] = "2 monitor", ["LOI 3"] = "3 payload", ["LOI 4"] = "4 control", ["LOI 5"] = "5 launch",
}

-- The value of a field for the info column: by its name where it has one.
local function note_text(field, bytes)
  if field.chars then
    local stop = bytes:find("\0", 1, true)
    -- What is not printable would make the output of tshark no text.
    return ((stop and bytes:sub(1, stop - 1) or bytes):gsub("[^\32-\126]", "?"))
  end
  local value = unsigned(bytes)
  local enum = field.values
  if enum and enum.bits then
    local names = {}
    for _, bit in ipairs(enum.bits) do
      if math.floor(value / bit.mask) % 2 == 1 then names[#names + 1] = LEVELS[bit.name] or bit.name end
    end
    return #names > 0 and table.concat(names, " ") or "none"
  end
  if not enum then return number_text(value) end
  local range = range_text(enum, value)
  return enum.values[value] or number_text(value) .. (range and " " .. range or "")
end

local function add_field(tree, field, range)
  local bytes = range:raw()
  if field.chars then
    local stop = bytes:find("\0", 1, true)
    tree:add(field.proto, range, stop and bytes:sub(1, stop - 1) or bytes)
    return
  end
  if field.wire == "f32" or field.wire == "f64" then
    local value = range:float()
    local item = tree:add(field.proto, range, value)
    local time = field.unit == "s since 1970" and utc_text((value - EPOCH_UNIX_S) * 1000)
    if time then
      item:append_text(" (" .. time .. ")")
    elseif field.unit then
      item:append_text(" " .. field.unit)
    end
    check_range(item, field, value)
    return
  end
  if field.wire == "u40" and not field.step then
    local item = tree:add(field.proto, range, range:uint64())
    local text = field.time and utc_text(unsigned(bytes))
    if text then item:append_text(" (" .. text .. ")") end
    return
  end
  local value = WIRES[field.wire][3] and signed(bytes) or unsigned(bytes)
  if field.id then
    local item = tree:add(field.proto, range, unsigned(bytes))
    item:append_text(" (" .. id_text(unsigned(bytes)) .. ")")
  elseif field.step then
    local scaled = value * field.step
    local item = tree:add(field.proto, range, scaled)
    if field.unit then item:append_text(" " .. field.unit) end
    if field.unit == "rad" then
      item:append_text(string.format(" (%.7f deg)", math.deg(scaled)))
    end
    if field.wire == "u40" then
      item:add(field.raw, range, range:uint64())
    else
      item:add(field.raw, range, value)
    end
    check_range(item, field, scaled)
  elseif field.bits then
    local item = tree:add(field.proto, range, value)
    for _, bit in ipairs(field.bits) do item:add(bit, range) end
  else
    local item = tree:add(field.proto, range, value)
    local enum = field.values
    if enum and not enum.values[value] then
      item:append_text(" (" .. (range_text(enum, value) or "not named by any source") .. ")")
    end
    if field.unit then item:append_text(" " .. field.unit) end
    check_range(item, field, value)
  end
end

-- The presence vector as a table of booleans, or nil where it is faulty.
local function presence_vector(message, data, tree)
  local size = message.presence
  if data:len() < size then
    tree:add_proto_expert_info(expert.presence, string.format(
      "%d bytes, expected a presence vector of %d", data:len(), size))
    return
  end
  local vector = data:range(0, size):raw()
  local item = tree:add(header.presence, data:range(0, size))
  local present = {}
  for bit = 0, 8 * size - 1 do
    local byte = vector:byte(size - math.floor(bit / 8))
    present[bit] = math.floor(byte / 2 ^ (bit % 8)) % 2 == 1
    if present[bit] and bit >= #message.fields then
      item:add_proto_expert_info(expert.presence, string.format(
        "bit %d is set, the message has %d fields", bit, #message.fields))
      return
    end
  end
  return present
end

-- Presence vector and fields. Stops at the first fault: what follows cannot be located. Edition 2.5 has no vector: each
-- field is present.
local function dissect_data(message, data, tree, notes)
  local size = message.presence
  local present = size > 0 and presence_vector(message, data, tree)
  if size > 0 and not present then return end
  local offset = size
  for index, field in ipairs(message.fields) do
    if not present or present[index - 1] then
      local bytes = field.chars or (WIRES[field.wire] or {})[1]
      if not bytes then
        if offset < data:len() then tree:add(field.proto, data:range(offset)) end
        tree:add_proto_expert_info(expert.unsized, field.name .. ": no source gives its length")
        return
      end
      if data:len() - offset < bytes then
        tree:add_proto_expert_info(expert.field, string.format(
          "%s: %d bytes left, expected %d", field.name, data:len() - offset, bytes))
        return
      end
      add_field(tree, field, data:range(offset, bytes))
      if field.note then
        local text = note_text(field, data:range(offset, bytes):raw())
        notes[#notes + 1] = field.note == "" and text or field.note .. " " .. text
      end
      offset = offset + bytes
    end
  end
  if offset < data:len() then
    tree:add(header.trailing, data:range(offset))
    tree:add_proto_expert_info(expert.trailing, string.format(
      "%d bytes after the last field", data:len() - offset))
  end
end

-- The header at an offset, and what is wrong with it; nil where there is no room for one.
local function read_header(tvb, offset)
  local left = tvb:len() - offset
  if left < HEADER then return nil, "short" end
  local properties = tvb:range(offset + 14, 2):uint()
  local found = {
    reserved = tvb:range(offset, 2):uint(),
    length = tvb:range(offset + 2, 2):uint(),
    source = tvb:range(offset + 4, 4):uint(),
    destination = tvb:range(offset + 8, 4):uint(),
    type = tvb:range(offset + 12, 2):uint(),
    idd = math.floor(properties / 256) % 128,
    style = math.floor(properties / 64) % 4,
    low = properties % 64,
  }
  found.sum_bytes = CHECKSUM_BYTES[found.style]
  found.total = HEADER + found.length + found.sum_bytes
  if found.length < 1 or found.length > MAX_DATA then return found, "length" end
  if found.total > left then return found, "short" end
  return found
end

local function add_checksum(tree, place, expected)
  local item = tree:add(header.checksum, place, place:uint())
  if place:uint() == expected then
    item:append_text(" (correct)")
  else
    item:append_text(" (incorrect)")
    item:add_proto_expert_info(expert.checksum,
      string.format("0x%x, expected 0x%x", place:uint(), math.floor(expected)))
  end
end

-- One message. Returns the offset after it, or nil where the next one cannot be located.
local function dissect_message(tvb, offset, tree, labels)
  local found, fault = read_header(tvb, offset)
  if not found then
    local item = tree:add(header.trailing, tvb:range(offset))
    item:add_proto_expert_info(expert.short, string.format(
      "%d bytes, expected a header of %d", tvb:len() - offset, HEADER))
    return
  end
  local size = fault and tvb:len() - offset or found.total
  local message = MESSAGES[found.type]
  local label = found.type .. " " .. (message and message.name or "unknown")
  labels[#labels + 1] = label
  local subtree = tree:add(proto, tvb:range(offset, size), "STANAG 4586 DLI, " .. label)
  subtree:add(header.reserved, tvb:range(offset, 2))
  local length = subtree:add(header.length, tvb:range(offset + 2, 2))
  subtree:add(header.source, tvb:range(offset + 4, 4))
    :append_text(" (" .. id_text(found.source) .. ")")
  subtree:add(header.destination, tvb:range(offset + 8, 4))
    :append_text(" (" .. id_text(found.destination) .. ")")
  subtree:add(header.type, tvb:range(offset + 12, 2))
  local properties = subtree:add(header.properties, tvb:range(offset + 14, 2))
  properties:add(header.ack, tvb:range(offset + 14, 2))
  local idd = properties:add(header.idd, tvb:range(offset + 14, 2))
  local style = properties:add(header.style, tvb:range(offset + 14, 2))
  if found.idd < IDD_ED3 or found.idd > IDD_ED4 then idd:add_proto_expert_info(expert.idd) end
  if found.idd == IDD_ED3 and found.style == 3 then style:add_proto_expert_info(expert.style) end
  if fault == "length" then
    length:add_proto_expert_info(expert.length, string.format(
      "%d, expected 1 to %d", found.length, MAX_DATA))
    return
  elseif fault then
    length:add_proto_expert_info(expert.short, string.format(
      "%d bytes, expected a message of %d", tvb:len() - offset, found.total))
    return
  end
  local data = tvb:range(offset + HEADER, found.length)
  if message then
    subtree:append_text(message.provisional and " (layout derived from Edition 2)" or "")
    local notes = {}
    dissect_data(message, data, subtree, notes)
    if #notes > 0 then labels[#labels] = label .. " (" .. table.concat(notes, ", ") .. ")" end
  else
    subtree:add(header.data, data):add_proto_expert_info(expert.unknown)
  end
  if found.sum_bytes > 0 then
    local place = tvb:range(offset + HEADER + found.length, found.sum_bytes)
    add_checksum(subtree, place,
      checksum_of(found.style, tvb:range(offset, HEADER + found.length):raw()))
  end
  return offset + found.total
end

-- Edition 2.5: a datagram begins with a digit, where later editions have zeros or ones.
local HEADER_25, MAX_DATA_25, TRAILER_25 = 30, 514, 4
local VERSIONS_25 = { ["2.5"] = true, ["7"] = true, ["8"] = true, ["9"] = true }

-- Amendment 1 calls itself 9 and has no field 5 in message 1501.
local IDENT_OF_AMENDMENT_1 = { name = MESSAGES_25[1501].name, presence = 0, fields = {} }
for index = 1, 4 do IDENT_OF_AMENDMENT_1.fields[index] = MESSAGES_25[1501].fields[index] end

local function message_25(found)
  if found.version == "9" and found.type == 1501 then return IDENT_OF_AMENDMENT_1 end
  return MESSAGES_25[found.type]
end

local function is_25(tvb)
  local first = tvb:range(0, 1):uint()
  return first >= 0x31 and first <= 0x39
end

local function read_header_25(tvb, offset)
  local left = tvb:len() - offset
  if left < HEADER_25 then return nil, "short" end
  local version = tvb:range(offset, 10):raw()
  local stop = version:find("\0", 1, true)
  local found = {
    version = stop and version:sub(1, stop - 1) or version,
    instance = tvb:range(offset + 10, 4):uint(),
    type = tvb:range(offset + 14, 4):uint(),
    length = tvb:range(offset + 18, 4):uint(),
  }
  found.total = HEADER_25 + found.length + TRAILER_25
  if found.length < 1 or found.length > MAX_DATA_25 then return found, "length" end
  if found.total > left then return found, "short" end
  return found
end

local function checksum_25(tvb, offset, found)
  local place = tvb:range(offset + HEADER_25 + found.length, TRAILER_25)
  return place, sum(tvb:range(offset, HEADER_25 + found.length):raw(), 0x100000000)
end

-- One message of Edition 2.5. Returns the offset after it, or nil where the next one cannot be located.
local function dissect_message_25(tvb, offset, tree, labels)
  local found, fault = read_header_25(tvb, offset)
  if not found then
    local item = tree:add(header.trailing, tvb:range(offset))
    item:add_proto_expert_info(expert.short, string.format(
      "%d bytes, expected a header of %d", tvb:len() - offset, HEADER_25))
    return
  end
  local size = fault and tvb:len() - offset or found.total
  local message = message_25(found)
  local label = found.type .. " " .. (message and message.name or "unknown")
  labels[#labels + 1] = label
  local subtree = tree:add(proto, tvb:range(offset, size), "STANAG 4586 DLI, Edition 2.5, " .. label)
  -- What is not printable would make the output of tshark no text.
  local printable = found.version:gsub("[^\32-\126]", "?")
  local version = subtree:add(header.version, tvb:range(offset, 10), printable)
  if not VERSIONS_25[found.version] then version:add_proto_expert_info(expert.idd) end
  subtree:add(header.instance, tvb:range(offset + 10, 4))
  subtree:add(header.type_25, tvb:range(offset + 14, 4))
  local length = subtree:add(header.length_25, tvb:range(offset + 18, 4))
  subtree:add(header.stream, tvb:range(offset + 22, 4))
  subtree:add(header.sequence, tvb:range(offset + 26, 4))
  if fault == "length" then
    length:add_proto_expert_info(expert.length, string.format(
      "%d, expected 1 to %d", found.length, MAX_DATA_25))
    return
  elseif fault then
    length:add_proto_expert_info(expert.short, string.format(
      "%d bytes, expected a message of %d", tvb:len() - offset, found.total))
    return
  end
  local data = tvb:range(offset + HEADER_25, found.length)
  if message then
    local notes = {}
    dissect_data(message, data, subtree, notes)
    if #notes > 0 then labels[#labels] = label .. " (" .. table.concat(notes, ", ") .. ")" end
  else
    subtree:add(header.data, data):add_proto_expert_info(expert.unknown)
  end
  add_checksum(subtree, checksum_25(tvb, offset, found))
  return offset + found.total
end

function proto.dissector(buffer, pinfo, tree)
  local tvb = buffer
  if tvb:len() == 0 then return 0 end
  pinfo.cols.protocol = "DLI"
  local labels = {}
  if tvb:len() > MAX_DATAGRAM then
    local item = tree:add(header.trailing, tvb:range(MAX_DATAGRAM))
    item:add_proto_expert_info(expert.oversized, string.format(
      "%d bytes, expected at most %d", tvb:len(), MAX_DATAGRAM))
  end
  local dissect = is_25(tvb) and dissect_message_25 or dissect_message
  local offset = 0
  while offset and offset < tvb:len() do
    offset = dissect(tvb, offset, tree, labels)
  end
  pinfo.cols.info = table.concat(labels, ", ")
  return tvb:len()
end

-- The heuristic: a datagram on another port is ours only if every message in it is valid to the last byte. Every
-- UDP datagram without a dissector of its own passes here, and a weaker test would claim those of other protocols.
local function valid_25(tvb)
  local offset = 0
  repeat
    local found, fault = read_header_25(tvb, offset)
    if fault or not VERSIONS_25[found.version] or not message_25(found) then return false end
    local place, expected = checksum_25(tvb, offset, found)
    if place:uint() ~= expected then return false end
    offset = offset + found.total
  until offset == tvb:len()
  return true
end

local function valid(tvb)
  if tvb:len() == 0 or tvb:len() > MAX_DATAGRAM then return false end
  if is_25(tvb) then return valid_25(tvb) end
  local offset = 0
  repeat
    local found, fault = read_header(tvb, offset)
    if fault or found.low ~= 0 or not MESSAGES[found.type] then return false end
    if found.reserved ~= 0 and found.reserved ~= 0xFFFF then return false end
    if found.idd < IDD_ED3 or found.idd > IDD_ED4 then return false end
    if found.length < MESSAGES[found.type].presence then return false end
    if found.sum_bytes > 0 then
      local place = tvb:range(offset + HEADER + found.length, found.sum_bytes)
      local bytes = tvb:range(offset, HEADER + found.length):raw()
      if place:uint() ~= checksum_of(found.style, bytes) then return false end
    end
    offset = offset + found.total
  until offset == tvb:len()
  return true
end

proto:register_heuristic("udp", function(buffer, pinfo, tree)
  if not proto.prefs.heuristics or not valid(buffer) then return false end
  proto.dissector(buffer, pinfo, tree)
  return true
end)

local ports = proto.prefs.ports
local udp = DissectorTable.get("udp.port")
udp:add(ports, proto)

function proto.prefs_changed()
  if ports == proto.prefs.ports then return end
  if ports ~= "" then udp:remove(ports, proto) end
  ports = proto.prefs.ports
  if ports ~= "" then udp:add(ports, proto) end
end
