-- For wrk: motions with distinct targets and traces, as a program that moves a robot far too often sends them.
local function hex(digits)
   local text = ""
   for _ = 1, digits do text = text .. string.format("%x", math.random(0, 15)) end
   return text
end

function request()
   local body = string.format('{"targets": [{"joint": "shoulder_pan_joint", "position": %.4f}]}', math.random())
   local fields = {
      ["Content-Type"] = "application/json",
      ["Idempotency-Key"] = hex(32),
      ["Traceparent"] = "00-" .. hex(32) .. "-" .. hex(16) .. "-01",
   }
   return wrk.format("POST", "/ur5/actions/moveJoints", fields, body)
end
