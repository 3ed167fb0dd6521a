//! Checks a document against a JSON Schema. Supports the keywords that the schemas in docs/ use,
//! and no others.

use serde_json::Value;

/// Where and how `document` violates `schema`; empty if it is valid.
///
/// # Panics
/// At an unknown keyword, so that none is silently ignored.
pub fn errors(schema: &Value, document: &Value) -> Vec<String> {
    let mut errors = Vec::new();
    check(schema, schema, document, "$", &mut errors);
    errors
}

fn check(root: &Value, schema: &Value, value: &Value, path: &str, errors: &mut Vec<String>) {
    let mut wrong = |what: String| errors.push(format!("{path}: {what}"));
    let mut inner = Vec::new();
    for (keyword, rule) in schema.as_object().expect("a schema is an object") {
        match keyword.as_str() {
            "$schema" | "$defs" | "title" | "description" => {}
            "$ref" => {
                let place = rule.as_str().and_then(|rule| rule.strip_prefix('#')).expect("a place in this schema");
                let schema = root.pointer(place).unwrap_or_else(|| panic!("{place} is not in the schema"));
                check(root, schema, value, path, &mut inner);
            }
            "anyOf" => {
                let fits = |schema: &Value| {
                    let mut errors = Vec::new();
                    check(root, schema, value, path, &mut errors);
                    errors
                };
                let of_each: Vec<_> = rule.as_array().unwrap().iter().map(fits).collect();
                if of_each.iter().all(|errors| !errors.is_empty()) {
                    inner.extend(of_each.into_iter().flatten());
                }
            }
            "type" => {
                let is = |kind: &Value| match kind.as_str().unwrap() {
                    "null" => value.is_null(),
                    "boolean" => value.is_boolean(),
                    "string" => value.is_string(),
                    "number" => value.is_number(),
                    "integer" => value.is_i64() || value.is_u64(),
                    "array" => value.is_array(),
                    "object" => value.is_object(),
                    kind => panic!("the type {kind} is not known here"),
                };
                let fits = rule.as_array().map_or_else(|| is(rule), |kinds| kinds.iter().any(is));
                if !fits {
                    wrong(format!("{value} is not of the type {rule}"));
                }
            }
            "const" if value != rule => wrong(format!("{value} is not {rule}")),
            "enum" if !rule.as_array().unwrap().contains(value) => wrong(format!("{value} is none of {rule}")),
            "const" | "enum" => {}
            "minimum" if value.as_f64() < rule.as_f64() => wrong(format!("{value} is less than {rule}")),
            "exclusiveMinimum" if value.as_f64() <= rule.as_f64() => wrong(format!("{value} is not above {rule}")),
            "minimum" | "exclusiveMinimum" => {}
            "minItems" | "maxItems" => {
                let (length, limit) = (value.as_array().map_or(0, Vec::len) as u64, rule.as_u64().unwrap());
                if if keyword == "minItems" { length < limit } else { length > limit } {
                    wrong(format!("{length} items, against {keyword} {limit}"));
                }
            }
            "items" => {
                for (index, item) in value.as_array().into_iter().flatten().enumerate() {
                    check(root, rule, item, &format!("{path}[{index}]"), &mut inner);
                }
            }
            "required" => {
                for field in rule.as_array().unwrap() {
                    if value.as_object().is_some_and(|object| !object.contains_key(field.as_str().unwrap())) {
                        wrong(format!("the field {field} is missing"));
                    }
                }
            }
            "properties" => {
                for (field, schema) in rule.as_object().unwrap() {
                    if let Some(value) = value.get(field) {
                        check(root, schema, value, &format!("{path}.{field}"), &mut inner);
                    }
                }
            }
            "additionalProperties" if *rule == Value::Bool(true) => {}
            keyword => panic!("the keyword {keyword} is not known here"),
        }
    }
    errors.extend(inner);
}
